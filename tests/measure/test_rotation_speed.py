"""Rotation speeds against closed forms, and recordings that show none."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from rotating_events import poisson_events, spokes, texture, turning_edges

from evis.events import open_recording
from evis.events.measure import Measurement

DATA = Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))


def rotation(events: tuple[np.ndarray, ...], size: tuple[int, int] = (120, 100)) -> dict:
    measurement = Measurement(*size)
    for first in range(0, len(events[0]), 50_000):
        measurement.add(*(v[first : first + 50_000] for v in events))
    return measurement.report()["rotation"]


@pytest.mark.parametrize("omega", [15.0, -180.0, *(pytest.param(w, marks=pytest.mark.slow) for w in (-42.0, 70.0))])
def test_steady_speed(omega):
    """Within 0.5 %: descriptors of 1 ms place a recurrence to a fraction of one."""
    events = turning_edges(lambda t: omega * t, min(0.6, 25 / abs(omega)), texture())
    found = rotation(events)
    assert found["omega_rad_s"] == pytest.approx(abs(omega), rel=0.005)
    assert found["direction"] == ("clockwise" if omega > 0 else "counterclockwise")
    assert found["steady"] and found["method"] == "periodicity" and not found["reverses"]
    assert found["confidence"] > 0.5
    assert np.hypot(*(np.array(found["pivot_px"]) - (60, 50))) < 3


@pytest.mark.parametrize("count", [6, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 4))])
def test_repeated_pattern(count):
    """The spectrum peaks at a multiple of the revolutions; the order is told, and the speed is that of the object."""
    omega = 30.0
    found = rotation(turning_edges(lambda t: omega * t, 0.5, spokes(count)))
    assert found["omega_rad_s"] == pytest.approx(omega, rel=0.01)
    strongest = found["candidates"][0]
    assert strongest["order"] % count == 0
    assert strongest["frequency_hz"] == pytest.approx(strongest["order"] * omega / (2 * np.pi), rel=0.03)
    assert f"passes {strongest['order']} times per revolution" in found["ambiguity"]


@pytest.mark.parametrize(("count", "omega"), [(12, 30.0), pytest.param(6, 200.0, marks=pytest.mark.slow)])
def test_many_spokes(count, omega):
    """Returns of the pattern 1/12 of a turn, or at 200 rad/s few ms, apart: the right one is the revolution."""
    found = rotation(turning_edges(lambda t: omega * t, 0.4, spokes(count)))
    assert found["omega_rad_s"] == pytest.approx(omega, rel=0.01)
    assert found["steady"] and found["method"] == "periodicity"


def test_slow():
    """5 rad/s, where a window of 30 ms turns by 0.15 rad: 95 % of the series within 3 %."""
    found = rotation(turning_edges(lambda t: 5.0 * t, 0.6, texture()))
    speeds = np.array(found["series"])[:, 1]
    assert np.percentile(np.abs(speeds - 5.0), 95) < 0.15


@pytest.mark.slow
def test_too_fast_for_its_spokes_is_no_speed():
    """24 sectors at 280 rad/s move by half a period in a descriptor: two speeds explain them, so none is stated."""
    found = rotation(turning_edges(lambda t: 280.0 * t, 0.3, spokes(12)))
    assert found["omega_rad_s"] is None and found["confidence"] < 0.5


def test_ramp():
    """A speed that grows from 10 to 50 rad/s: series within 2 % (median) and 10 % (95th percentile)."""
    found = rotation(turning_edges(lambda t: 10 * t + 40 * t**2, 0.5, texture()))
    series = np.array(found["series"])
    wanted = 10 + 80 * series[:, 0] * 1e-9
    error = np.abs(series[:, 1] - wanted) / wanted
    assert np.median(error) < 0.02 and np.percentile(error, 95) < 0.10
    assert not found["steady"] and found["method"] == "tracked angle"


@pytest.mark.slow
def test_reversal():
    """omega = 35 cos(6 t): the sign of the series turns where the rotation does."""
    found = rotation(turning_edges(lambda t: 35 / 6 * np.sin(6 * t), 0.5, texture()))
    series = np.array(found["series"])
    wanted = 35 * np.cos(6 * series[:, 0] * 1e-9)
    sign = 1 if found["direction"] == "clockwise" else -1
    assert np.median(np.abs(sign * series[:, 1] - wanted)) < 1.5
    assert np.percentile(np.abs(sign * series[:, 1] - wanted), 95) < 4
    assert found["reverses"] and not found["steady"]


@pytest.mark.slow
def test_long_recording_is_one_rotation():
    """Over several stretches the speed stays one number, and noise does not hide it."""
    turning = turning_edges(lambda t: 40 * t, 2.6, texture(count=12), jitter_us=300)
    noise = poisson_events(2.0, 2.6, (120, 100))
    together = [np.concatenate(pair) for pair in zip(turning, noise)]
    order = np.argsort(together[0], kind="stable")
    found = rotation(tuple(v[order] for v in together))
    assert found["omega_rad_s"] == pytest.approx(40, rel=0.005) and found["steady"]
    assert found["revolutions"] == pytest.approx(40 * 2.6 / (2 * np.pi), rel=0.05)


def translating(speed: float) -> tuple[np.ndarray, ...]:
    """Random short vertical edges that slide over the image."""
    random = np.random.default_rng(0)
    parts = []
    for x0, y0, p in zip(random.uniform(-60, 100, 60), random.integers(0, 90, 60), random.integers(0, 2, 60)):
        for y in range(int(y0), int(y0) + 8):
            x = np.arange(max(0, int(np.ceil(x0))), min(120, int(x0 + speed * 0.5)))
            parts.append(((x - x0) / speed + random.normal(0, 2e-4, len(x)), x, np.full(len(x), y), np.full(len(x), p)))
    t, x, y, p = (np.concatenate([part[i] for part in parts]) for i in range(4))
    keep = (t >= 0) & (y < 100)
    order = np.argsort(t[keep], kind="stable")
    t, x, y, p = (v[keep][order] for v in (t, x, y, p))
    return np.round(t * 1e9).astype(np.int64), x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8)


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(lambda: translating(150.0), marks=pytest.mark.slow),
        lambda: poisson_events(20.0, 0.5, (120, 100)),
    ],
)
def test_no_rotation(make):
    """What slides, and noise: no speed, and a low confidence."""
    found = rotation(make())
    assert found["omega_rad_s"] is None and found["series"] == []
    assert found["confidence"] < 0.5 and found["why"]


@pytest.mark.parametrize(
    "name",
    [
        "txt/slider_depth_events_chunk.txt",
        pytest.param("derived/gen31_vga_from_bag1.raw", marks=pytest.mark.slow),
    ],
)
def test_no_rotation_in_real_recordings(name):
    """A camera on a slider, and a person with a rope."""
    if not (DATA / name).exists():
        pytest.skip(f"no {DATA / name} (set EVIS_TEST_DATA)")
    with open_recording(DATA / name) as recording:
        events = recording.read()
        found = rotation((events.t, events.x, events.y, events.p), (recording.info.width, recording.info.height))
    assert found["omega_rad_s"] is None and found["confidence"] < 0.5
