"""Extremes of time, size and length: nothing wraps, drifts or is lost."""

import math

import numpy as np
import pytest

from nodes.event_sensor.parameters import CROSSINGS
from nodes.event_sensor.sensor import EventSensor

MS = 1_000_000
ONE = np.zeros(1, np.int32)
COLUMNS = ("t", "x", "y", "p")
TEN_HOURS = 36_000 * 10**9


def run(images, t, **params):
    """Events of images [T, H, W], all of them; dL/dt is given as 0."""
    images = np.asarray(images, np.float32)
    sensor = EventSensor(*images.shape[1:], **params)
    more = {"dlog_dt": np.zeros((1, *images.shape), np.float32)} if params.get("crossing") == "hermite" else {}
    parts = [sensor.process(images[None], np.asarray(t, np.int64), ONE, **more), sensor.flush()]
    return {c: np.concatenate([getattr(p, c) for p in parts]) for c in COLUMNS}


def walk(frames, height, width, seed=0, sigma=0.4):
    return np.exp(np.cumsum(np.random.default_rng(seed).normal(0, sigma, (frames, height, width)), 0))


@pytest.mark.parametrize("crossing", CROSSINGS)
@pytest.mark.parametrize("start", [TEN_HOURS, 2**62, -(2**62)])
def test_time_has_no_origin(crossing, start):
    """E8: at 10 h and at 2^62 ns the same events to the ns; as float32 seconds 10 h resolves 4 ms, as float64 7 ns."""
    images, t = walk(12, 5, 6), np.arange(12, dtype=np.int64) * 1_000_003
    params = {"crossing": crossing, "refractory_us": 100.0 if crossing == "linear" else 0.0}
    near, far = run(images, t, **params), run(images, t + start, **params)
    assert len(near["t"]) > 200
    assert (far["t"] - start).tolist() == near["t"].tolist()
    assert all(far[c].tolist() == near[c].tolist() for c in "xyp")


@pytest.mark.parametrize("crossing", CROSSINGS)
@pytest.mark.parametrize("step", [1, 17, 1000, 10 * 10**9])
def test_steps_from_a_nanosecond_to_ten_seconds(crossing, step):
    """The same frames give the same events per pixel, at times that scale with the step, to the nearest ns."""
    images = walk(12, 5, 6)
    scaled, plain = (run(images, np.arange(12, dtype=np.int64) * s, crossing=crossing) for s in (step, 2**30))
    order = [np.lexsort((e["t"], e["x"], e["y"])) for e in (scaled, plain)]
    for c in "xy":
        assert scaled[c][order[0]].tolist() == plain[c][order[1]].tolist()
    late = scaled["t"][order[0]] - plain["t"][order[1]] / 2**30 * step
    # An event is at least 1 ns after its frame's start; 2^-30 of a step comes from the grid of the other.
    assert late.max() < 1.001 + step * 2.0**-29 and late.min() > -0.501 - step * 2.0**-29


@pytest.mark.parametrize("crossing", CROSSINGS)
def test_steps_of_very_different_length_side_by_side(crossing):
    """1 ns, 10 s, 1 us, 1 ms ...: every event lies in a step in which its pixel moved, and the sums are right."""
    rng = np.random.default_rng(5)
    t = np.cumsum(np.concatenate([[0], 10 ** rng.integers(0, 11, 60)]))
    images = walk(61, 3, 4, seed=1)
    images[-2:] = images[0] * math.exp(0.5)
    events = run(images, t, crossing=crossing)
    net = np.zeros((3, 4), int)
    np.add.at(net, (events["y"], events["x"]), np.where(events["p"], 1, -1))
    # 2.5 thresholds above the start: level 2, or 3 when it comes from above.
    assert ((net == 2) | (net == 3)).all()
    assert events["t"].min() > 0 and events["t"].max() <= t[-1]


def test_ten_million_steps_leave_no_residual():
    """A walk over seven levels, back to the first value; then the next level is where it would be without the walk.

    The reference is a whole number of thresholds from the first frame, so the bound is that of one float32 sample in
    L, 6e-8, which is 0.2 us of this ramp.
    """
    steps, chunk = 10_000_000, 1_000_000
    values = np.exp(0.37 * np.arange(7)).astype(np.float32)
    rng = np.random.default_rng(0)
    sensor = EventSensor(1, 1, threshold=0.2)
    sensor.process(values[:1].reshape(1, 1, 1, 1), np.zeros(1, np.int64), ONE)
    on = off = 0
    for first in range(0, steps, chunk):
        which = rng.integers(0, 7, chunk)
        if first + chunk == steps:
            which[-1] = 0
        t = (np.arange(first, first + chunk, dtype=np.int64) + 1) * MS
        events = sensor.process(values[which].reshape(1, chunk, 1, 1), t, ONE)
        on, off = on + int((events.p == 1).sum()), off + int((events.p == 0).sum())
    assert on == off > steps
    last = steps * MS
    final = np.array([math.exp(0.3)], np.float32).reshape(1, 1, 1, 1)
    events = sensor.process(final, np.array([last + 10**9]), ONE)
    assert len(events.t) == 1 and abs(events.t[0] - last - 10**9 * 0.2 / 0.3) < 0.5 + 2 * 6e-8 / 0.3 * 1e9


@pytest.mark.parametrize("crossing", CROSSINGS)
def test_one_pixel(crossing):
    events = run(np.exp([[[0.0]], [[1.0]], [[1.0]]]), np.arange(3) * MS, crossing=crossing, threshold=0.3)
    assert len(events["t"]) == 3 and events["x"].max() == events["y"].max() == 0


def test_sixteen_million_pixels():
    """4096 x 4096: the corners and the middle step by 1 nat, the rest is still."""
    where = [(0, 0), (0, 4095), (2048, 2047), (4095, 0), (4095, 4095)]
    images = np.ones((2, 4096, 4096), np.float32)
    images[1][tuple(zip(*where))] = math.e
    events = run(images, [0, MS], threshold=0.3)
    assert len(events["t"]) == 5 * 3
    assert list(zip(events["y"][:5].tolist(), events["x"][:5].tolist())) == where
    assert events["t"].tolist() == np.repeat([300_000, 600_000, 900_000], 5).tolist()


@pytest.mark.parametrize("crossing", ["linear", "cubic"])
def test_all_pixels_at_once(crossing):
    """A flash: 3 events of each of 500 x 700 pixels at the same three times, in the order of rows and columns."""
    images = np.ones((4, 500, 700), np.float32)
    images[1:3] = np.float32(math.exp(0.7))
    events = run(images, np.arange(4) * MS, threshold=0.2, crossing=crossing)
    size = 500 * 700
    assert len(events["t"]) == 6 * size and len(np.unique(events["t"])) == 6
    pixel = events["y"].astype(int) * 700 + events["x"]
    assert (pixel.reshape(6, size) == np.arange(size)).all()
    assert events["p"].tolist() == [1] * 3 * size + [0] * 3 * size


@pytest.mark.parametrize("crossing", CROSSINGS)
@pytest.mark.parametrize("power", [-20, 62, 63, 70, 120])
def test_light_has_no_unit(crossing, power):
    """ln (2^k I) = ln I + k ln 2: the same events in any unit, also where the square of the light is beyond float32."""
    t = np.arange(24)[:, None, None] * 0.05
    rng = np.random.default_rng(8)
    phase, rate, depth = rng.uniform(0, 6, (4, 20)), rng.uniform(1, 9, (4, 20)), rng.uniform(0.05, 1.5, (4, 20))
    images = np.exp(2 + depth * np.sin(rate * t + phase)).astype(np.float32)
    params = {"crossing": crossing, "threshold": 0.1, "dark_level": 0.25}
    plain = run(images, np.arange(24) * MS, **params)
    scaled = run(images * 2.0**power, np.arange(24) * MS, **params | {"dark_level": 0.25 * 2.0**power})
    assert len(plain["t"]) > 1000
    assert all(scaled[c].tolist() == plain[c].tolist() for c in COLUMNS)


def test_a_bad_sample_is_no_dark_one():
    """One sample below the floor comes, then NaN while the pixel is looked at: it is held, and not counted again."""
    for params in ({}, {"refractory_us": 0.5}, {"leak_rate": 1e4}):
        sensor = EventSensor(1, 1, threshold=0.2, **params)
        images = np.array([1.0, 1e-9, np.nan, np.nan, np.nan], np.float32).reshape(1, 5, 1, 1)
        sensor.process(images, np.arange(5) * MS, ONE)
        counts = sensor.counts()
        assert (counts["clipped"], counts["nonfinite"]) == (1, 3)
