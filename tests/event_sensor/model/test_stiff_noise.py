"""Faults at any step: rates, dead times and filters that do not know the frame rate."""

import math

import numpy as np
import pytest
from scipy import stats

from nodes.event_sensor.sensor import EventSensor

MS = 1_000_000
ONE = np.zeros(1, np.int32)
COLUMNS = ("t", "x", "y", "p")


def run(images, t, seed=0, **params):
    """Events of images [T, H, W], all of them, fed by 100 frames a call."""
    images, t = np.asarray(images, np.float32), np.asarray(t, np.int64)
    sensor = EventSensor(*images.shape[1:], seed=seed, **params)
    parts = [sensor.process(images[None, k : k + 100], t[k : k + 100], ONE) for k in range(0, len(t), 100)]
    parts.append(sensor.flush())
    return {c: np.concatenate([getattr(p, c) for p in parts]) for c in COLUMNS}


def constant(rate, seconds, height, width, value=0.25):
    """Frames of constant light."""
    count = round(rate * seconds) + 1
    t = np.rint(np.arange(count) * 1e9 / rate).astype(np.int64)
    return np.broadcast_to(np.float32(value), (count, height, width)), t


NOISE = {
    "shot": ({"shot_rate": 40.0, "shot_white": 1.0}, 30.0),
    "hot": ({"hot_pixel_fraction": 1.0, "hot_pixel_rate": 300.0}, 300.0),
    "both": ({"shot_rate": 40.0, "shot_white": 1.0, "hot_pixel_fraction": 1.0, "hot_pixel_rate": 20.0}, 50.0),
}


@pytest.mark.parametrize("name", NOISE)
def test_noise_is_the_same_at_any_frame_rate(name):
    """E5: in constant light the very same events at 30 Hz, where rate x step is up to 10, at 100 Hz and at 10 kHz."""
    params, rate = NOISE[name]
    runs = [run(*constant(fps, 1.0, 20, 30), **params) for fps in (30, 100, 10_000)]
    for other in runs[1:]:
        assert all(other[c].tolist() == runs[0][c].tolist() for c in COLUMNS)
    expected = 600 * rate
    assert abs(len(runs[0]["t"]) - expected) < 5 * math.sqrt(expected)


@pytest.mark.parametrize("name", NOISE)
def test_noise_is_poisson(name):
    """Waiting times exponential, counts with variance equal to the mean, both polarities alike, pixels independent."""
    params, rate = NOISE[name]
    events = run(*constant(100, 2.0, 30, 50), seed=7, **params)
    pixel = events["y"].astype(int) * 50 + events["x"]
    order = np.lexsort((events["t"], pixel))
    waits = np.diff(events["t"][order])[np.diff(pixel[order]) == 0] * 1e-9
    # Waits are cut by the end of the run: only those that begin early enough to end in it are compared.
    early = events["t"][order][:-1][np.diff(pixel[order]) == 0] < 1e9
    limit = 1.0
    law = stats.truncexpon(b=limit * rate, scale=1 / rate)
    assert stats.kstest(waits[early & (waits < limit)], law.cdf).pvalue > 1e-4
    counts = np.bincount(pixel, minlength=1500)
    assert counts.var() / counts.mean() == pytest.approx(1, abs=5 * math.sqrt(2 / 1500))
    n = len(events["t"])
    assert abs((events["p"] == 1).sum() - n / 2) < 5 * math.sqrt(n / 4)


def test_shot_noise_falls_with_light_and_ends_at_white():
    """r (1 - clip(I / I_white, 0, 1)) for I = 0.01 to 3 and I_white = 2."""
    for value in (0.01, 0.5, 1.5, 2.0, 3.0):
        n = len(run(*constant(50, 1.0, 30, 40, value), shot_rate=20.0, shot_white=2.0)["t"])
        expected = 1200 * 20.0 * (1 - min(value / 2, 1))
        assert abs(n - expected) <= 5 * math.sqrt(expected)


def test_leak_is_the_same_at_any_frame_rate():
    """5 Hz for 1.1 s: floor(5.5 + u) ON events in every pixel, u uniform; the same events at any frame rate.

    To 2^-21, the rounding within which a frame has reached a level, at 5 Hz x 0.2 = 1 / s: 480 ns.
    """
    runs = [run(*constant(fps, 1.1, 20, 30), leak_rate=5.0) for fps in (10, 100, 10_000)]
    for events in runs:
        pixel = events["y"].astype(int) * 30 + events["x"]
        order = np.lexsort((events["t"], pixel))
        np.testing.assert_allclose(np.diff(events["t"][order])[np.diff(pixel[order]) == 0], 200 * MS, rtol=0, atol=480)
        counts = np.bincount(pixel, minlength=600)
        assert (events["p"] == 1).all() and set(counts.tolist()) == {5, 6}
        assert abs(counts.mean() - 5.5) < 5 * 0.5 / math.sqrt(600)
        events["t"] = events["t"][order]
    for other in runs[1:]:
        np.testing.assert_allclose(other["t"], runs[0]["t"], rtol=0, atol=480)


@pytest.mark.parametrize("fps,count,size", [(100, 100, 50), (10_000, 10_000, 15), (100, 200, 50)])
def test_leak_has_its_rate_from_the_first_frame_on(fps, count, size):
    """Of T seconds each pixel has floor(5 T + u) events: 5 Hz on average, deviation 0.5 at most."""
    images, t = constant(fps, (count - 1) / fps, size, size)
    n = len(run(images, t, leak_rate=5.0, seed=3)["t"])
    assert len(t) == count and abs(n - 5.0 * size**2 * t[-1] * 1e-9) < 5 * 0.5 * size


def test_leak_shares_the_crossings_with_the_signal():
    """A ramp of 3 nat/s and a leak of 5 Hz x 0.2 = 1 nat/s cross every 50 ms; falling at 3 nat/s every 100 ms, OFF."""
    t = np.arange(1001, dtype=np.int64) * MS
    for slope, apart, polarity in ((3.0, 50 * MS, 1), (-3.0, 100 * MS, 0)):
        events = run(np.exp(slope * t * 1e-9)[:, None, None], t, leak_rate=5.0, threshold=0.2)
        assert (events["p"] == polarity).all()
        np.testing.assert_allclose(np.diff(events["t"]), apart, atol=300)


@pytest.mark.parametrize("dead_us", [1.0, 40.0, 1000.0, 50_000.0])
@pytest.mark.parametrize("frame_ns", [MS, 100 * MS])
def test_dead_time_holds_the_pixel_in_reset(dead_us, frame_ns):
    """E7: 5 nat/s at C 0.2 is 40 ms, and after the dead time the reference is the signal: 40 ms + dead time exactly.

    ESIM's rule would give 80 ms for 50 ms, v2e's 50 ms.
    """
    t = np.arange(0, 2000 * MS + 1, frame_ns)
    events = run(np.exp(5e-9 * t)[:, None, None], t, refractory_us=dead_us, threshold=0.2)
    np.testing.assert_allclose(np.diff(events["t"]), 40 * MS + dead_us * 1e3, atol=200)
    assert len(events["t"]) == (2000 * MS + round(dead_us * 1e3)) // round(40 * MS + dead_us * 1e3)


def test_dead_time_within_a_step():
    """One frame of 1 ms that rises by 10 nats, C 0.2, 30 us dead: every 20 + 30 us."""
    events = run(np.exp([0, 10.0])[:, None, None], [0, MS], refractory_us=30.0, threshold=0.2)
    np.testing.assert_allclose(np.diff(events["t"]), 50_000, atol=1)
    assert len(events["t"]) == 20


def test_dead_time_longer_than_the_run():
    rng = np.random.default_rng(0)
    images = np.exp(np.cumsum(rng.normal(0, 0.5, (200, 6, 7)), 0))
    events = run(images, np.arange(200) * MS, refractory_us=1e9)
    assert len(events["t"]) == 42 and len(set(zip(events["x"].tolist(), events["y"].tolist()))) == 42


@pytest.mark.parametrize("fault", [
    {"leak_rate": 1.0}, {"shot_rate": 30.0, "shot_white": 1e6}, {"hot_pixel_fraction": 1.0, "hot_pixel_rate": 30.0},
    {"refractory_us": 20_000.0}, {"threshold_mismatch": 0.02, "shot_rate": 10.0, "shot_white": 1e6},
])  # fmt: skip
def test_no_pixel_goes_deaf(fault):
    """Ten seconds of constant light, then a step of 1 nat: every pixel answers with 3 ON events or more."""
    t = np.concatenate([np.arange(0, 10_001, 100), [10_001, 10_200]]) * MS
    images = np.ones((len(t), 10, 20))
    images[-2:] = math.e
    fault = {"refractory_us": 0.0, **fault}
    events = run(images, t, threshold=0.2, **fault)
    late = (events["t"] > 10_000 * MS) & (events["p"] == 1)
    counts = np.bincount(events["y"][late].astype(int) * 20 + events["x"][late], minlength=200)
    # In dead time of 20 ms a step of 1 ms is over: one event, and the pixel is at its new light.
    assert counts.min() >= (1 if fault["refractory_us"] else 3)


@pytest.mark.parametrize("ratio", [1e-3, 0.053, 0.3, 1.0, 7.0, 50.0, 1e3, 1e6])
def test_low_pass_is_exact_at_any_time_constant(ratio):
    """E6: a step of A in 1 ns, frames of 1 ms, tau = ratio x 1 ms: floor(A (1 - exp(-t / tau)) / C) by each frame."""
    tau_ns, height, threshold = ratio * MS, 9.07, 0.001 if ratio > 100 else 0.1
    t = np.concatenate([[0, 1], np.arange(1, 400) * MS])
    images = np.exp(np.concatenate([[0], np.full(400, height)]))[:, None, None]
    bandwidth = 1e9 / (2 * math.pi * tau_ns)
    events = run(images, t, bandwidth_hz=bandwidth, threshold=threshold)
    response = -height * np.expm1(-(t[1:] - 0.5) / tau_ns)
    counts = np.searchsorted(events["t"], t[1:], "right")
    # The filtered light is float32 again: 6e-8 in L.
    low, high = (np.floor((response + d) / threshold) for d in (-2e-7, 4e-7))
    assert ((counts >= low) & (counts <= high)).all() and counts[-1] > 0


def test_low_pass_times_are_those_of_the_exponential():
    """t_k = -tau ln(1 - k C / A), frames of tau / 50: a chord of the exponential is off by dt^2 / (8 tau) at most."""
    tau = 5 * MS
    t = np.concatenate([[0, 1], np.arange(1, 400) * tau // 50])
    images = np.exp(np.concatenate([[0], np.full(400, 2.0)]))[:, None, None]
    events = run(images, t, bandwidth_hz=1e9 / (2 * math.pi * tau), threshold=0.15)
    k = np.arange(1, len(events["t"]) + 1)
    expected = -tau * np.log1p(-k * 0.15 / 2.0)
    assert len(k) == 13
    assert np.abs(events["t"] - expected).max() < (tau / 50) ** 2 / (8 * tau) * 1.05 + 2
