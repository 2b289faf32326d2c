"""The event sensor against signals whose events are known in closed form, and against a float64 model of a pixel."""

import math

import numpy as np
import pytest

from nodes.event_sensor.sensor import FLOOR, EventSensor
from nodes.event_sensor.simulate import simulate_frames

C = 0.15
MS = 1_000_000


def pixel(signal, t, **params):
    """Events (t, p) of one pixel that sees exp(signal)."""
    params = {"threshold_on": C, "threshold_off": C, **params}
    frames = np.exp(np.asarray(signal, np.float64)).astype(np.float32)
    events = simulate_frames(frames[:, None, None], t, **params)
    return events["t"], events["p"]


def model(intensity, t, on=C, off=C, dark=0.0):
    """One pixel in float64, event by event: the reference follows in steps, a NaN sample holds the last value."""
    events = []
    reference = level = None
    start = t[0]
    steps = [0, 0]
    for value, now in zip(intensity.astype(np.float64), t):
        if math.isfinite(value) and value >= 0:
            new = math.log(max(value + dark, FLOOR))
            if reference is None:
                base = level = new
                reference = base
            while new - reference >= on - 2**-21 or reference - new >= off - 2**-21:
                up = new > reference
                steps[up] += 1
                reference = base + steps[1] * on - steps[0] * off
                events.append((start + (reference - level) / (new - level) * (now - start), int(up)))
            level = new
        start = now
    return events


@pytest.mark.parametrize("slope", [20.0, -3.0, 700.0])
def test_ramp_fires_at_k_c_over_s(slope):
    """E1. The stamp error is that of the float32 frames: 6e-8 in L, which is 6e-8 / slope seconds, and 0.5 ns."""
    t = np.arange(101, dtype=np.int64) * MS
    times, polarity = pixel(slope * t * 1e-9, t)
    k = np.arange(1, len(times) + 1)
    assert len(times) == int(abs(slope) * 0.1 / C + 1e-6)
    assert (polarity == (slope > 0)).all()
    assert np.abs(times - k * C / abs(slope) * 1e9).max() <= 0.5 + 1.3e-7 / abs(slope) * 1e9


@pytest.mark.parametrize("steps", [1, 3])
def test_light_that_returns_to_its_value_but_for_rounding_gives_its_events_back(steps):
    """A square wave that begins at one of its values: each return ends at a threshold. As computed light does, it comes
    back to within four units of float32's last place."""
    rng = np.random.default_rng(steps)
    count, pixels = 40, 200
    t = np.arange(count, dtype=np.int64) * MS
    high = rng.uniform(0.1, 10.0, pixels).astype(np.float32)
    low = (high * np.exp(-(steps + 0.7) * C)).astype(np.float32)
    frames = np.where((np.arange(count) % 2 == 0)[:, None], high, low)
    off = rng.integers(-2, 3, frames.shape, np.int32)
    frames = (frames.view(np.int32) + off).view(np.float32)
    events = simulate_frames(frames[:, None], t, threshold_on=C, threshold_off=C)
    counts = np.zeros((2, pixels), int)
    np.add.at(counts, (events["p"], events["x"]), 1)
    assert (counts[0] == count // 2 * steps).all()
    assert (counts[1] == (count // 2 - 1) * steps).all()


def test_crossing_at_the_end_belongs_to_the_step_and_an_exact_one_is_not_lost():
    t = np.arange(9, dtype=np.int64) * MS
    times, _ = pixel(C * np.arange(9), t)
    assert times.tolist() == t[1:].tolist()


@pytest.mark.parametrize("frequency", [1.0, 10.0, 25.0])
def test_sinusoid_counts_and_times(frequency):
    """E2 where the samples resolve the period: 16 crossings per slope of amplitude 1.2, at arcsin times."""
    amplitude, rate = 1.2, 8000
    t = np.arange(rate + 1, dtype=np.int64) * (10**9 // rate)
    phase = 2 * np.pi * frequency * t * 1e-9
    times, polarity = pixel(amplitude * np.sin(phase), t)
    per_slope = 2 * math.floor(amplitude / C + 1e-9)
    assert (polarity == 1).sum() == (polarity == 0).sum() == frequency * per_slope
    first = np.arcsin(C * np.arange(1, 8) / amplitude) / (2 * np.pi * frequency) * 1e9
    # A chord of the sine over one sample: the time is off by at most (w dt)^2 / 8 * tan(phase) / w.
    bound = (1e9 / rate) ** 2 * (2 * np.pi * frequency * 1e-9) / 8 * np.tan(np.arcsin(C * 7 / amplitude)) + 10
    assert np.abs(times[:7] - first).max() < bound


def test_step_over_the_whole_range_fires_every_threshold():
    """E3: ln((65504 + 1e-5) / 1e-5) / 0.15 = 150.7."""
    frames = np.zeros((2, 3, 4), np.float32)
    frames[1] = 65504
    events = simulate_frames(frames, np.array([0, MS]), threshold_on=C, threshold_off=C, dark_level=1e-5)
    assert len(events["t"]) == 150 * 12
    k = np.arange(1, 151)
    expected = np.rint(k * C / math.log(65504e5 + 1) * MS)
    one = events["t"][(events["x"] == 2) & (events["y"] == 1)]
    assert np.abs(one - expected).max() <= 1


def test_signal_that_returns_leaves_no_trace():
    """10,000 cycles between two levels: ON and OFF agree and the reference has not moved by one rounding."""
    t = np.arange(20_001, dtype=np.int64) * MS
    signal = np.where(np.arange(20_001) % 2, 0.47, 0.0)
    times, polarity = pixel(signal, t)
    assert (polarity == 1).sum() == (polarity == 0).sum() == 3 * 10_000
    assert len(set((times[polarity == 1] % MS).tolist())) == 3


@pytest.mark.parametrize("on,off", [(0.1, 0.3), (0.25, 0.11)])
def test_different_thresholds(on, off):
    t = np.arange(5, dtype=np.int64) * MS
    _, polarity = pixel([0, 1.0, 0, 1.0, 0], t, threshold_on=on, threshold_off=off)
    expected = [p for _, p in model(np.exp(np.array([0, 1.0, 0, 1.0, 0])), t, on, off)]
    assert polarity.tolist() == expected


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1.0, 0.0])
def test_bad_frame_fires_nothing_and_leaves_the_pixel_as_it_was(bad):
    """E4: the same events as if the last good value had been held; afterwards the pixel fires as before."""
    signal = np.exp(np.linspace(0, 3, 13)).astype(np.float32)
    t = np.arange(13, dtype=np.int64) * MS
    for at in (1, 6, 12):
        spoilt, held = signal.copy(), signal.copy()
        spoilt[at], held[at] = bad, signal[at - 1]
        got = simulate_frames(spoilt[:, None, None], t, threshold_on=C, threshold_off=C)
        want = simulate_frames(held[:, None, None], t, threshold_on=C, threshold_off=C)
        assert got["t"].tolist() == want["t"].tolist()
        assert got["nonfinite"] == 1 and want["nonfinite"] == 0
        assert (got["t"] > t[at]).any() or at == 12


def test_bad_first_frame_puts_the_reference_off():
    signal = np.array([np.nan, 1.0, 2.0], np.float32)
    events = simulate_frames(signal[:, None, None], np.array([0, MS, 2 * MS]), threshold_on=0.5)
    assert events["t"].tolist() == [MS + round(0.5 / math.log(2) * MS)]


def test_almost_black_without_dark_current_is_finite_and_counted():
    """An ideal sensor at 1e-30: the floor of 2^-24 is 83 thresholds of 0.2 below 1, and back."""
    signal = np.array([1.0, 1e-30, 1e-30, 1.0], np.float32)
    events = simulate_frames(signal[:, None, None], np.arange(4) * MS)
    n = math.floor(-math.log(FLOOR) / 0.2)
    assert (events["p"] == 0).sum() == (events["p"] == 1).sum() == n
    assert events["clipped"] == 1


def test_black_without_dark_current_has_no_logarithm_and_is_skipped():
    signal = np.array([1.0, 0.0, 0.0, 2.0, 1e-8, 0.0, 1e-8], np.float32)
    events = simulate_frames(signal[:, None, None], np.arange(7) * MS)
    assert events["p"].tolist() == [1] * 3 + [0] * math.floor((0.6 - math.log(FLOOR)) / 0.2)
    assert events["t"][0] > 2 * MS and events["nonfinite"] == 3


def random_walk(rng, shape):
    steps = rng.normal(0, 0.12, shape) * (rng.random(shape) < 0.5)
    return np.exp(np.cumsum(steps, 0)).astype(np.float32)


@pytest.mark.parametrize("dark", [0.0, 0.3])
def test_equals_the_float64_model(dark):
    rng = np.random.default_rng(3)
    frames = random_walk(rng, (200, 6, 7))
    frames[rng.random(frames.shape) < 0.01] = np.nan
    t = np.cumsum(rng.integers(1, 5 * MS, 200))
    events = simulate_frames(frames, t, threshold_on=0.15, threshold_off=0.19, dark_level=dark)
    for y in range(6):
        for x in range(7):
            mine = (events["y"] == y) & (events["x"] == x)
            expected = model(frames[:, y, x], t, 0.15, 0.19, dark)
            assert events["p"][mine].tolist() == [p for _, p in expected]
            # 0.5 ns of rounding, and an event is at least 1 ns after its step's start.
            assert np.abs(events["t"][mine] - np.array([s for s, _ in expected])).max() <= 1.001


@pytest.mark.parametrize("k", [1, 8, 32])
def test_events_do_not_depend_on_how_frames_are_packed(k):
    rng = np.random.default_rng(4)
    frames = random_walk(rng, (129, 5, 6))
    t = np.arange(129, dtype=np.int64) * MS
    whole = simulate_frames(frames, t)
    sensor = EventSensor(5, 6)
    episodes = np.zeros(1, np.int32)
    packets = [sensor.process(frames[None, :1], t[:1], episodes)]
    for first in range(1, 129, k):
        packet = sensor.process(frames[None, first : first + k], t[first : first + k], episodes)
        assert sensor.t_base == t[first - 1]
        assert ((packet.t > t[first - 1]) & (packet.t <= t[min(first + k, 129) - 1])).all()
        packets.append(packet)
    assert len(packets[0].t) == 0
    for name in ("t", "x", "y", "p"):
        assert np.concatenate([getattr(p, name) for p in packets]).tolist() == whole[name].tolist()


def test_a_static_scene_has_no_events():
    frames = np.broadcast_to(np.random.default_rng(0).uniform(0, 9, (1, 20, 30)), (50, 20, 30)).astype(np.float32)
    assert len(simulate_frames(frames, np.arange(50) * MS, threshold_on=0.001, threshold_off=0.001)["t"]) == 0
