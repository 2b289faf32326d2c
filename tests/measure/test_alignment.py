"""The alignment of a window's events: it finds the speed from either side, also where the view cuts the pattern."""

from __future__ import annotations

import numpy as np
import pytest
from rotating_events import spokes, texture, turning_edges

from evis.events.measure.rotation.alignment import align, in_view
from evis.events.measure.rotation.merge import merge
from evis.events.measure.rotation.plane import Plane
from evis.events.measure.rotation.rotation import nothing
from evis.events.measure.rotation.tracking import rival

PIVOT, SIZE, HALF_S = np.array([60.0, 50.0]), (120, 100), 0.02


def window(edges: list, omega: float = 20.0) -> tuple[np.ndarray, ...]:
    """Events within 20 ms of 0.1 s: tau [s], x, y, p."""
    t, x, y, p = turning_edges(lambda at: omega * at, 0.2, edges)
    tau = t * 1e-9 - 0.1
    part = np.abs(tau) < HALF_S
    return tau[part], x[part].astype(float), y[part].astype(float), p[part]


@pytest.mark.parametrize("edges", [texture(), spokes(1), spokes(5)], ids=["texture", "half", "spokes"])
@pytest.mark.parametrize("start", [17.0, 20.0, 23.0])
def test_speed_from_either_side(edges, start):
    """Within 0.5 % of 20 rad/s, from 15 % off too, and about a pivot that is 3 px off: times are known to 0.2 ms."""
    tau, x, y, p = window(edges)
    found, gathered = align(tau, x - PIVOT[0] - 2, y - PIVOT[1] + 2, p, HALF_S, start)
    assert found == pytest.approx(20.0, rel=0.005)
    assert gathered > 0.5


def test_a_cut_does_not_hold_the_motion_back():
    """The view ends at column 75 and row 65: with the events that stay in view the speed is free of the cut's pull."""
    tau, x, y, p = window(spokes(1))
    view = np.array([0.0, 75.0, 0.0, 65.0])
    seen = (x <= view[1]) & (y <= view[3])
    tau, x, y, p = tau[seen], x[seen], y[seen], p[seen]
    u, v = Plane(PIVOT).from_image(x, y)
    inner = in_view(tau, u, v, HALF_S, 20.0, Plane(PIVOT), view)
    assert 40 < inner.sum() < len(tau)
    found, _ = align(tau[inner], u[inner], v[inner], p[inner], HALF_S, 20.0)
    assert found == pytest.approx(20.0, rel=0.005)


def test_in_view_against_a_loop():
    """An event stays in view if all of its places do, at the window's ends, quarters and middle; on an ellipse here."""
    tau, u, v, _ = (v[::37] for v in window(texture()))
    view, flat = np.array([20.0, 90.0, 10.0, 80.0]), np.exp([0.3, -0.3])
    u, v = u - PIVOT[0], v - PIVOT[1]
    for k, kept in enumerate(in_view(tau, u, v, HALF_S, 20.0, Plane(PIVOT, (0.3, 0.0)), view)):
        places = []
        for at in (-HALF_S, -HALF_S / 2, 0.0, HALF_S / 2, HALF_S):
            turn = np.exp(1j * 20.0 * (at - tau[k])) * complex(u[k], v[k])
            places.append((PIVOT[0] + turn.real / flat[0], PIVOT[1] + turn.imag / flat[1]))
        assert kept == all(view[0] <= u <= view[1] and view[2] <= v <= view[3] for u, v in places)


def test_a_rotation_of_few_events_is_no_speed_of_the_recording():
    """One stretch in ten turns: its confidence, by its share of the events, is too low to state a speed."""
    part = {"omega_rad_s": 5.0, "confidence": 0.9, "steady": True, "direction": "clockwise", "reverses": False}
    part |= {"revolutions": 1.0, "series": [[0, 5.0], [10**9, 5.0]], "events": 1000}
    turning = nothing("") | part
    rest = [nothing("noise") | {"events": 1000} for _ in range(9)]
    found = merge([turning, *rest])
    assert (found["omega_rad_s"], found["series"], found["confidence"]) == (None, [], 0.09)
    assert merge([turning, turning | {"series": [[2 * 10**9, 5.0], [3 * 10**9, 5.0]]}])["omega_rad_s"] == 5.0


def test_rival():
    """The second peak, not the slope of the first."""
    assert rival(np.array([0.0, 1, 4, 1, 0, 3, 0])) == 0.75
    assert rival(np.array([0.0, 1, 4, 3, 2, 1, 0])) == 0.0
