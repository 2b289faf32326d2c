"""Rotations seen at an angle, slow ones, several at once and none: the right speed or none."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from rotating_events import poisson_events, spokes, texture, turning_edges

from evis.events.measure import Measurement
from evis.events.measure.rotation.coherence import coherence
from evis.events.measure.rotation.plane import Plane
from evis.events.measure.rotation.polar import harmonics_of, rings_of

SIZE = (120, 100)


def rotation(events: tuple[np.ndarray, ...], size: tuple[int, int] = SIZE) -> dict:
    measurement = Measurement(*size)
    for first in range(0, len(events[0]), 50_000):
        measurement.add(*(v[first : first + 50_000] for v in events))
    return measurement.report()["rotation"]


def off(found: dict, omega: float) -> float:
    """95th percentile of the series' relative error."""
    return float(np.percentile(np.abs(np.array(found["series"])[:, 1] / omega - 1), 95))


def together(*streams: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    t, x, y, p = (np.concatenate(parts) for parts in zip(*streams))
    order = np.argsort(t, kind="stable")
    return t[order], x[order], y[order], p[order]


@pytest.mark.parametrize(
    ("tilt", "omega", "duration"),
    [
        (45.0, 30.0, 0.12),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in ((60.0, 30.0, 0.12), (60.0, 100.0, 0.4))),
        *(pytest.param(tilt, 30.0, 0.6, marks=pytest.mark.slow) for tilt in (35.0, 60.0, 70.0)),
    ],
)
def test_tilted_disk(tilt, omega, duration):
    """In its own plane a tilted disk turns evenly: speed and series within 1 %, after half a revolution too."""
    found = rotation(turning_edges(lambda t: omega * t, duration, texture(), tilt_deg=tilt))
    assert found["confidence"] >= 0.5
    assert found["omega_rad_s"] == pytest.approx(omega, rel=0.01) and off(found, omega) <= 0.01
    assert found["tilt_deg"] == pytest.approx(tilt, abs=4)


@pytest.mark.slow
def test_tilted_disk_that_gathers_speed():
    """15 to 51 rad/s in 0.6 s at 60 degrees: 95 % of the series within 2 %."""
    found = rotation(turning_edges(lambda t: 15 * t + 30 * t**2, 0.6, texture(), tilt_deg=60.0))
    series = np.array(found["series"])
    assert np.percentile(np.abs(series[:, 1] / (15 + 60e-9 * series[:, 0]) - 1), 95) <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("omega", "tilt"), [(50, 35), (60, 45), (15, 25)])
def test_the_simulators_own_disk(omega, tilt, tmp_path):
    """In perspective, textured and lit: the speed within 1 %, 95 % of the series within 4 %."""
    bag = tmp_path / "disk.mcap"
    launch = ["launch", "spinning_disk", f"omega:={omega}", f"tilt:={tilt}", "width:=160", "height:=120"]
    for command in (
        [*launch, "--duration", "1", "--no-view", "--record", str(bag)],
        ["events", "measure", str(bag), "--json"],
    ):
        done = subprocess.run(
            [sys.executable, "-m", "evis", *command], capture_output=True, text=True, env=os.environ, check=True
        )
    found = json.loads(done.stdout)["rotation"]
    assert found["omega_rad_s"] == pytest.approx(omega, rel=0.01) and off(found, omega) <= 0.04
    assert found["revolutions"] == pytest.approx(omega / (2 * np.pi), rel=0.05)


@pytest.mark.parametrize(
    ("omega", "duration"),
    [(1.0, 0.6), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((0.3, 2.0), (0.5, 2.0), (2.0, 2.0)))],
)
def test_slow_rotation(omega, duration):
    """Tenths of a radian per second: windows of 0.2 s see enough of them."""
    found = rotation(turning_edges(lambda t: omega * t, duration, texture()))
    assert found["confidence"] >= 0.5 and found["direction"] == "clockwise"
    assert found["omega_rad_s"] == pytest.approx(omega, rel=0.01) and off(found, omega) <= 0.02
    at = np.array([t for t, _ in found["series"]])
    assert at[0] < 0.25e9 and at[-1] > duration * 1e9 - 0.25e9


def two_wheels(first: float, second: float, size: float) -> tuple[np.ndarray, ...]:
    """A textured wheel left and one of spokes, `size` times as large, right of it; speeds in rad/s."""
    left = turning_edges(lambda t: first * t, 0.5, texture(), (60.0, 50.0), (240, 100))
    edges = [(a, inner * size, outer * size, p) for a, inner, outer, p in spokes(3)]
    return together(left, turning_edges(lambda t: second * t, 0.5, edges, (180.0, 50.0), (240, 100)))


@pytest.mark.slow
@pytest.mark.parametrize(("first", "second", "size"), [(30.0, 60.0, 0.5), (30.0, -50.0, 1.0), (30.0, 30.0, 1.0)])
def test_two_wheels(first, second, size):
    """The speed of one of them, or none: nothing in between."""
    found = rotation(two_wheels(first, second, size), (240, 100))
    speed = found["omega_rad_s"]
    assert speed is None or min(abs(speed / abs(w) - 1) for w in (first, second)) < 0.01
    assert speed is not None or (found["confidence"] < 0.5 and found["why"])


def sheared() -> tuple[np.ndarray, ...]:
    """Points above the middle go right, those below go left, at 150 px/s: locally like a turn, but none."""
    random = np.random.default_rng(0)
    parts = []
    for row in range(SIZE[1]):
        speed = 150.0 if row < SIZE[1] / 2 else -150.0
        for start in random.uniform(-100, 220, 12):
            x = np.arange(SIZE[0])
            t = (x - start) / speed + random.normal(0, 1e-4, len(x))
            seen = (t >= 0) & (t < 0.6)
            parts.append((t[seen] * 1e9, x[seen], np.full(seen.sum(), row), np.full(seen.sum(), row // 4 % 2)))
    t, x, y, p = together(*parts)
    return t.astype(np.int64), x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8)


def flickering() -> tuple[np.ndarray, ...]:
    """Pixels all over the view, ON and OFF in turn at 50 Hz."""
    random = np.random.default_rng(0)
    parts = []
    for half in range(60):
        place = np.flatnonzero(random.random(SIZE[0] * SIZE[1]) < 0.3)
        t = (half / 100 + 0.005 + random.normal(0, 1e-3, len(place))) * 1e9
        parts.append((t, place % SIZE[0], place // SIZE[0], np.full(len(place), half % 2)))
    t, x, y, p = together(*parts)
    return t.astype(np.int64), x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8)


def one_event() -> tuple[np.ndarray, ...]:
    return np.array([7]), np.array([3], np.uint16), np.array([4], np.uint16), np.array([1], np.uint8)


@pytest.mark.parametrize(
    "make",
    [
        one_event,
        lambda: poisson_events(0.005, 3.0, SIZE),
        pytest.param(sheared, marks=pytest.mark.slow),
        pytest.param(flickering, marks=pytest.mark.slow),
    ],
    ids=["one event", "few events", "sheared", "flickering"],
)
def test_no_rotation_is_no_speed(make):
    """None stated, and why."""
    found = rotation(make())
    assert found["omega_rad_s"] is None and found["series"] == [] and found["confidence"] < 0.5 and found["why"]


def test_plane_is_a_stretch():
    """60 degrees about the x axis: y is doubled against x, areas stay, and the way back is the way."""
    plane = Plane(np.array([10.0, 20.0]), (-0.5 * np.log(2), 0.0))
    assert np.degrees(plane.tilt_rad) == pytest.approx(60)
    u, v = plane.from_image(np.array([11.0, 10.0]), np.array([20.0, 21.0]))
    assert v[1] / u[0] == pytest.approx(2) and u[0] * v[1] - u[1] * v[0] == pytest.approx(1)
    x, y = Plane(np.zeros(2), (0.2, -0.4)).from_image(*np.array([[3.0], [5.0]]))
    assert np.allclose(Plane(np.zeros(2), (0.2, -0.4)).to_image(x, y), [[3.0], [5.0]])


def test_coherence_of_the_right_and_of_a_wrong_angle():
    """Near 1 with the true angle, near 0 with half of it or backwards, unknown where hardly anything turned."""
    t, x, y, p = turning_edges(lambda at: 30 * at, 0.2, texture())
    u, v = x - 60.0, y - 50.0
    steps = int(t[-1] // 1_000_000) + 1
    coefficients, _ = harmonics_of(t // 1_000_000, steps, u, v, p.astype(np.int64), rings_of(u, v))
    true = 30 * (np.arange(steps) + 0.5) * 1e-3
    assert coherence(coefficients, true) > 0.9
    assert abs(coherence(coefficients, 0.5 * true)) < 0.2 and abs(coherence(coefficients, -true)) < 0.2
    assert np.isnan(coherence(coefficients, 0.1 * true))
