"""The ideal sensor against its definition in extended precision, where many pixels are sensed together."""

import numpy as np
import pytest

from nodes.event_sensor.sensor import FLOOR, EventSensor

TOLERANCE = 2.0**-21
ONE = np.zeros(1, np.int32)


def truth(frames, t, on, off, dark):
    """Per pixel, its (t, p): levels at whole thresholds from the first sample, straight lines in L between frames."""
    wide = np.maximum(frames.astype(np.longdouble) + np.longdouble(dark), np.longdouble(FLOOR))
    levels = np.log(wide).reshape(len(t), -1)
    events = []
    for signal in levels.T:
        mine = []
        ups = downs = 0
        for k in range(1, len(t)):
            l0, l1 = signal[k - 1 : k + 1]
            while True:
                reference = signal[0] + ups * np.longdouble(on) - downs * np.longdouble(off)
                rises = l1 > reference
                if abs(l1 - reference) + TOLERANCE < (on if rises else off):
                    break
                ups, downs = ups + rises, downs + (not rises)
                level = signal[0] + ups * np.longdouble(on) - downs * np.longdouble(off)
                part = (level - l0) / (l1 - l0) * np.longdouble(t[k] - t[k - 1])
                mine.append((int(t[k - 1]) + min(max(float(part), 1.0), float(t[k] - t[k - 1])), int(rises)))
        events.append(mine)
    return events


def of_pixels(events, height, width, envs=1):
    """The same of a sensor's events, by environment, row and column."""
    pixel = np.repeat(np.arange(envs), np.diff(events.env_offsets)) * height * width
    pixel = pixel + events.y.astype(int) * width + events.x
    return [
        list(zip(events.t[pixel == i].tolist(), events.p[pixel == i].tolist())) for i in range(envs * height * width)
    ]


@pytest.mark.parametrize(("on", "off", "dark"), [(0.2, 0.2, 0.0), (0.13, 0.31, 0.0), (0.05, 0.07, 1e-3)])
@pytest.mark.parametrize("stride", [0.02, 0.3, 4.0])
def test_every_event_is_within_a_nanosecond_over_the_whole_range_of_float32(on, off, dark, stride):
    rng = np.random.default_rng(int(1e3 * on + stride))
    height, width, count = 7, 23, 19
    walk = rng.uniform(-14, 80, (1, height, width)) + np.cumsum(rng.normal(0, stride, (count, height, width)), 0)
    frames = np.exp(np.clip(walk, -15, 88)).astype(np.float32)
    t = np.cumsum(rng.integers(1, 3_000_000, count)) + 10**15
    sensor = EventSensor(height, width, threshold_on=on, threshold_off=off, dark_level=dark)
    got = of_pixels(sensor.process(frames[None], t, ONE), height, width)
    for mine, wanted in zip(got, truth(frames, t, on, off, dark), strict=True):
        assert [p for _, p in mine] == [p for _, p in wanted]
        # Half a nanosecond of rounding, and what float64 does to an L of up to 88 in a step of little contrast.
        assert all(abs(a - b) <= 1.0 for (a, _), (b, _) in zip(mine, wanted))


def test_lists_grow_in_the_middle_of_a_call_and_nothing_is_lost():
    # 120 pixels with 1,036 or 575 events in every step, where a list has 4,096 places at first.
    height, width, envs, count = 3, 40, 2, 11
    frames = np.ones((envs, count, height, width), np.float32)
    frames[0, 1::2] = 1e9
    frames[1, 1::2] = 1e-5
    t = np.arange(count, dtype=np.int64) * 1_000_000
    events = EventSensor(height, width, envs, threshold=0.02).process(frames, t, np.zeros(envs, np.int32))
    steps = [int((np.log(1e9) + TOLERANCE) / 0.02), int((np.log(1e5) + TOLERANCE) / 0.02)]
    assert np.diff(events.env_offsets).tolist() == [10 * height * width * n for n in steps]
    for env, n in enumerate(steps):
        part = slice(*events.env_offsets[env : env + 2])
        assert (np.diff(events.t[part]) >= 0).all()
        k = (events.t[part] - 1) // 1_000_000
        rising = k % 2 == env
        assert (events.p[part] == rising).all()
        assert (np.bincount(k, minlength=10) == height * width * n).all()


@pytest.mark.parametrize("more", [{}, {"event_cap": 1 << 20}, {"crossing": "monotone"}, {"refractory_us": 0.001}])
def test_lists_that_are_just_full_lose_nothing(more):
    # A list of 4,096 places; 7 more than the events may be written to.
    for n in (4087, 4088, 4089, 4095, 4096, 4097, 4103, 4104, 4105):
        frames = np.array([1e-6, 1e-6 * np.exp((n + 0.5) * 0.02)], np.float32).reshape(1, 2, 1, 1)
        sensor = EventSensor(1, 1, threshold=0.02, **more)
        parts = [sensor.process(frames[:, k : k + 1], np.array([k * 10**9]), ONE) for k in range(2)] + [sensor.flush()]
        assert sum(len(e.t) for e in parts) == n and (np.diff(np.concatenate([e.t for e in parts])) > 0).all()


@pytest.mark.parametrize("a_call", [1, 3, 8, 9, 40])
@pytest.mark.parametrize("crossing", ["linear", "frame"])
def test_cutting_into_calls_and_groups_changes_nothing(a_call, crossing):
    rng = np.random.default_rng(5)
    height, width, count = 50, 71, 40  # more than a block of pixels, and a rest
    frames = np.exp(np.cumsum(rng.normal(0, 0.2, (1, count, height, width)), 1)).astype(np.float32)
    frames[rng.random(frames.shape) < 0.01] = rng.choice(np.array([np.nan, np.inf, -1.0, 0.0], np.float32))
    t = np.cumsum(rng.integers(1, 2_000_000, count))

    def run(size):
        sensor = EventSensor(height, width, threshold=0.2, crossing=crossing)
        parts = [sensor.process(frames[:, k : k + size], t[k : k + size], ONE) for k in range(0, count, size)]
        return [np.concatenate([getattr(e, name) for e in parts]) for name in "txyp"], sensor.counts()

    (got, counts), (wanted, counts_wanted) = run(a_call), run(2)
    assert all(np.array_equal(a, b) for a, b in zip(got, wanted)) and counts == counts_wanted
    order = np.lexsort((got[1], got[2], got[0]))
    assert (order == np.arange(len(order))).all()


@pytest.mark.parametrize("crossing", ["linear", "monotone", "cubic"])
def test_negative_samples_are_set_aside_wherever_they_stand(crossing):
    # Products of two negative numbers are positive: a bound made of products alone lets them through.
    rng = np.random.default_rng(1)
    frames = np.full((1, 12, 16, 32), 1.5, np.float32)
    bad = rng.random(frames.shape) < 0.05
    bad[:, 0] = False
    frames[bad] = -1.0
    sensor = EventSensor(16, 32, threshold=0.2, crossing=crossing)
    t = np.arange(12) * 1000
    parts = [sensor.process(frames[:, k : k + 4], t[k : k + 4], ONE) for k in range(0, 12, 4)]
    parts.append(sensor.flush())
    assert sensor.counts()["nonfinite"] == bad.sum() and not any(len(e.t) for e in parts)
