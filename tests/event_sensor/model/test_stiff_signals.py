"""Steep, wide and bad signals: what they must give is known in closed form, whatever the crossing method."""

import math

import numpy as np
import pytest

from bench.event_sensor.alignment import align
from bench.event_sensor.signals import Sinusoids
from evis.events.measure.distance import EventStream
from nodes.event_sensor.parameters import CROSSINGS
from nodes.event_sensor.sensor import EventSensor

MS = 1_000_000
ONE = np.zeros(1, np.int32)
COLUMNS = ("t", "x", "y", "p")
CURVES = [c for c in CROSSINGS if c != "frame"]


def run(images, t, slopes=None, **params):
    """Events, all of them, of images [T, H, W] (or [T, W] or [T]), and what the sensor counted."""
    images = np.asarray(images, np.float32)
    images = images.reshape(len(images), *((1, 1, *images.shape[1:])[-2:] if images.ndim < 3 else images.shape[1:]))
    sensor = EventSensor(*images.shape[1:], **params)
    more = {}
    if params.get("crossing") == "hermite":
        more["dlog_dt"] = np.zeros((1, *images.shape), np.float32) if slopes is None else np.reshape(
            np.asarray(slopes, np.float32), (1, *images.shape))  # fmt: skip
    parts = [sensor.process(images[None], np.asarray(t, np.int64), ONE, **more), sensor.flush()]
    return {c: np.concatenate([getattr(p, c) for p in parts]) for c in COLUMNS}, sensor.counts()


@pytest.mark.parametrize("crossing", CURVES)
@pytest.mark.parametrize("slope", [5.0, -40.0, 900.0])
def test_every_curve_through_a_ramp_is_the_ramp(crossing, slope):
    """E1: t_k = k C / s. Float32 frames know L to 6e-8, two of them a slope to twice that; 0.5 ns of rounding."""
    t = np.arange(81, dtype=np.int64) * MS
    level = slope * t * 1e-9
    events, _ = run(np.exp(level), t, np.full(81, slope), threshold=0.15, crossing=crossing)
    k = np.arange(1, int(abs(level[-1]) / 0.15 + 1e-6) + 1)
    assert (events["p"] == (slope > 0)).all()
    assert np.abs(events["t"] - k * 0.15 / abs(slope) * 1e9).max() <= 0.5 + 2.5e-7 / abs(slope) * 1e9


def test_frame_stamps_are_those_of_the_frame_at_or_after_the_crossing():
    t = np.arange(81, dtype=np.int64) * MS
    events, _ = run(np.exp(5e-9 * t), t, threshold=0.17, crossing="frame")
    assert events["t"].tolist() == [math.ceil(34 * k) * MS for k in range(1, len(events["t"]) + 1)]


@pytest.mark.parametrize("crossing", CROSSINGS)
@pytest.mark.parametrize("frequency", [1.0, 50.0, 5000.0])
def test_sinusoids_to_5_khz_lose_less_than_a_hundredth(crossing, frequency):
    """E2: A = 1.2, C = 0.15, 64 frames a period, 40 phases: the count, and the times to a tenth of a frame."""
    signal = Sinusoids(1, 40, seed=2)
    signal.amplitude[:], signal.frequency[:] = 1.2, frequency
    frames = signal.record(64 * frequency, 3 / frequency)
    truth = signal.events(0.15, int(frames.t[-1]))
    events, _ = run(frames.luminance, frames.t, frames.dlog_dt, threshold=0.15, crossing=crossing)
    pairs = align(EventStream(*events.values(), 40, 1), truth, unpaired_ns=int(1e9 / frequency / 32))
    assert len(truth.t) > 3000
    assert pairs.missed < 0.01 * len(truth.t) and pairs.extra < 0.01 * len(truth.t)
    assert np.median(np.abs(pairs.error_ns)) < 1e9 / frequency / 64 * (0.6 if crossing == "frame" else 0.1)


@pytest.mark.parametrize("crossing", CROSSINGS)
@pytest.mark.parametrize("threshold", [0.001, 0.0099, 0.15, 1.0, 6.0, 10.0])
def test_step_of_one_to_a_thousand_million_has_every_event(crossing, threshold):
    """ln 1e9 = 20.72: floor(20.72 / C) events up, as many down, in order and inside their frames."""
    t = np.arange(6, dtype=np.int64) * MS
    images = np.array([1e-3, 1e-3, 1e6, 1e6, 1e-3, 1e-3])
    events, _ = run(images, t, threshold=threshold, crossing=crossing)
    n = math.floor(math.log(1e9) / threshold)
    assert events["p"].tolist() == [1] * n + [0] * n
    up, down = events["t"][:n], events["t"][n:]
    assert ((up > MS) & (up <= 2 * MS)).all() and ((down > 3 * MS) & (down <= 4 * MS)).all()
    assert (np.diff(events["t"]) >= 0).all()


@pytest.mark.parametrize("crossing", CROSSINGS)
def test_step_from_black_over_the_range_of_half_precision(crossing):
    """E3: ln((65504 + 1e-5) / 1e-5) / 0.15 = 150.7."""
    images = np.array([0, 0, 65504, 65504, 0, 0])
    events, counts = run(images, np.arange(6) * MS, threshold=0.15, dark_level=1e-5, crossing=crossing)
    assert events["p"].tolist() == [1] * 150 + [0] * 150
    assert counts["nonfinite"] == counts["clipped"] == 0


@pytest.mark.parametrize("crossing", CROSSINGS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1.0, -1e-30, 0.0])
def test_a_sample_without_a_logarithm_is_skipped_and_counted(crossing, bad):
    """E4: no event at it, and by the end the pixel has fired what the whole change demands; its neighbours as ever."""
    t = np.arange(40, dtype=np.int64) * MS
    images = np.exp(np.linspace(0, 3.05, 40))[:, None].repeat(3, 1)
    clean, _ = run(images, t, threshold=0.1, crossing=crossing)
    images[[10, 11, 25], 1] = bad
    events, counts = run(images, t, threshold=0.1, crossing=crossing)
    assert counts["nonfinite"] + counts["clipped"] == 3
    mine = events["x"] == 1
    assert (events["p"][mine] == 1).all() and mine.sum() == 30
    assert not ((events["t"][mine] > 9 * MS) & (events["t"][mine] <= 11 * MS)).any()
    for c in COLUMNS:
        assert events[c][~mine].tolist() == clean[c][clean["x"] != 1].tolist()


@pytest.mark.parametrize("crossing", CROSSINGS)
@pytest.mark.parametrize("threshold", [0.0371, 0.2])
def test_signals_that_return_give_as_many_off_as_on(crossing, threshold):
    """500 pixels, each 20 times between two values of its own: in running float32 sums 60 % of them lose events.

    Each value is held for four frames, so that the cubic sees edges and not the samples of a smooth wave.
    """
    rng = np.random.default_rng(0)
    low, high = rng.uniform(0.5, 2, 500), rng.uniform(3, 90, 500)
    images = np.repeat(np.stack([low, high] * 20 + [low]), 4, 0)
    slopes = np.zeros_like(images)
    events, _ = run(images, np.arange(164) * MS, slopes, threshold=threshold, crossing=crossing)
    counts = np.zeros((2, 500), int)
    np.add.at(counts, (events["p"], events["x"]), 1)
    l0, l1 = (np.log(v.astype(np.float32).astype(np.float64)) for v in (low, high))
    assert (counts[0] == counts[1]).all()
    assert (counts[1] == 20 * np.floor((l1 - l0) / threshold + 1e-6)).all()


def test_a_slow_signal_is_not_lost_at_a_high_frame_rate():
    """Steps of 8e-7 in L, below the 1e-6 that ESIM passes over: two events of 0.002 in 6000 frames, not none.

    A level is reached from within 2^-21 of it: 0.6 of a step.
    """
    level = np.float32(1) + np.arange(6001) * np.float32(2**-20)
    events, _ = run(level, np.arange(6001) * MS, threshold=0.002)
    k = np.arange(1, int(math.log(float(level[-1])) / 0.002) + 1)
    np.testing.assert_allclose(events["t"], np.expm1(0.002 * k) * 2**20 * MS, atol=0.6 * MS)
    assert len(k) == 2
