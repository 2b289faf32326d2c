"""What the models are measured with: closed-form events, pairing of events, the reference in float64."""

import functools
import itertools

import numpy as np
import pytest

from bench.event_sensor import disk
from bench.event_sensor.alignment import align
from bench.event_sensor.signals import FORMS, SECOND, Sinusoids, stamps
from evis.events.measure.distance import EventStream

MS = 1_000_000


def stream(t, p=None, x=None):
    t = np.asarray(t, np.int64)
    x = np.zeros(len(t), np.uint16) if x is None else np.asarray(x, np.uint16)
    p = np.ones(len(t), np.uint8) if p is None else np.asarray(p, np.uint8)
    return EventStream(t, x, np.zeros(len(t), np.uint16), p, 4, 1)


def cheapest(a, b, unpaired):
    """Least cost over all order-preserving pairings, tried one by one."""
    best = None
    for n in range(min(len(a), len(b)) + 1):
        for i in itertools.combinations(range(len(a)), n):
            for j in itertools.combinations(range(len(b)), n):
                cost = sum(abs(a[k] - b[m]) for k, m in zip(i, j)) + unpaired * (len(a) + len(b) - 2 * n)
                best = cost if best is None else min(best, cost)
    return best


def test_pairing_is_the_cheapest_one():
    rng = np.random.default_rng(0)
    for _ in range(60):
        a, b = (np.sort(rng.integers(0, 30, rng.integers(0, 6))) for _ in range(2))
        pairs = align(stream(a), stream(b), unpaired_ns=4)
        assert np.abs(pairs.error_ns).sum() + 4 * (pairs.missed + pairs.extra) == cheapest(a, b, 4)
        assert len(pairs.error_ns) + pairs.missed == pairs.reference == len(b)


def test_pairs_keep_to_their_pixel_and_polarity():
    reference = stream([10, 20, 30, 40], p=[1, 0, 1, 0], x=[0, 0, 1, 3])
    test = stream([11, 19, 33, 40], p=[1, 0, 1, 1], x=[0, 0, 1, 3])
    pairs = align(test, reference)
    assert sorted(pairs.error_ns.tolist()) == [-1, 1, 3] and (pairs.missed, pairs.extra) == (1, 1)
    assert align(test, test).figures() == {"median [us]": 0, "p99 [us]": 0, "missed [%]": 0, "extra [%]": 0}


def test_streams_larger_than_one_part_are_paired_alike(monkeypatch):
    rng = np.random.default_rng(1)
    a, b = (stream(np.sort(rng.integers(0, 10**8, 400)), rng.integers(0, 2, 400), rng.integers(0, 4, 400))
            for _ in range(2))  # fmt: skip
    whole = align(a, b)
    monkeypatch.setattr("bench.event_sensor.alignment.CELLS_AT_ONCE", 100)
    assert align(a, b).error_ns.tolist() == whole.error_ns.tolist()


def wave(amplitude, frequency, phase, t):
    return amplitude * np.sin(2 * np.pi * frequency * t + phase)


def walk_through(level, slope_sign_changes, threshold, end):
    """Events of one signal, found by bisection between samples that are dense against its period."""
    t = np.linspace(0, end, slope_sign_changes)
    values = level(t)
    reference, events = values[0], []
    for k in range(1, len(t)):
        while abs(values[k] - reference) >= threshold:
            reference += threshold if values[k] > reference else -threshold
            low, high = t[k - 1], t[k]
            for _ in range(60):
                middle = (low + high) / 2
                before = (level(np.array([middle]))[0] < reference) == (values[k] >= reference)
                low, high = (middle, high) if before else (low, middle)
            events.append((high, int(values[k] >= reference)))
    return events


def test_closed_form_of_the_sinusoid_is_what_bisection_finds():
    signal = Sinusoids(2, 3, seed=4)
    end = 500 * MS
    truth = signal.events(0.2, end)
    for y, x in np.ndindex(2, 3):
        level = functools.partial(wave, *(v[y, x] for v in (signal.amplitude, signal.frequency, signal.phase)))
        found = walk_through(level, 40_001, 0.2, end / SECOND)
        mine = (truth.x == x) & (truth.y == y)
        assert truth.p[mine].tolist() == [p for _, p in found]
        assert np.abs(truth.t[mine] - np.array([t for t, _ in found]) * SECOND).max() <= 1
    assert len(truth.t) > 100


@pytest.mark.parametrize("form", FORMS, ids=lambda f: f.name)
def test_closed_forms_invert_their_signal(form):
    truth = form.events(0.2, 400 * MS)
    k = np.arange(1, len(truth.t) + 1)
    before, after = (form.level((truth.t + d) / SECOND) for d in (-2, 2))
    assert (np.abs(before) <= 0.2 * k + 1e-9).all() and (np.abs(after) >= 0.2 * k - 1e-9).all()
    total = abs(form.level(np.array([0.4]))[0])
    assert len(k) == int(total / 0.2 + 1e-9) >= 10


def test_given_slopes_are_those_of_the_signal():
    t = np.array([0, 1, 2]) * 1000
    for soft in (1.0, 0.0):
        frames = disk.record(t, soft, 200, 60)
        slope = np.diff(np.log(frames.luminance.astype(np.float64)), axis=0) / 1e-6
        close = np.abs(slope - frames.dlog_dt[:2]) < 0.3 + 0.05 * np.abs(slope)  # float32: 1.2e-7 / 1e-6
        assert close.mean() > 0.98
        assert (np.abs(frames.dlog_dt[0]) > 100).mean() > 0.02 or soft == 0
    signal = Sinusoids(3, 3).record(1000, 0.002)
    slope = (np.log(signal.luminance[2]) - np.log(signal.luminance[0])) / 2e-3
    np.testing.assert_allclose(signal.dlog_dt[1], slope, rtol=0.01, atol=0.05)


def test_reference_returns_to_where_it_was():
    """Pixels that jump between two values of their own give as many OFF as ON events."""
    levels = np.random.default_rng(3).uniform(1, 99, (1, 50, 60)).astype(np.float32)
    frames = np.concatenate([levels, levels * np.float32(6), levels] * 3)
    events = disk.reference_events(frames[:9], np.arange(9) * MS, 0.2)
    assert (events.p == 1).sum() == (events.p == 0).sum() == 3000 * 3 * 8


def test_frames_are_at_whole_nanoseconds():
    assert stamps(125, 0.5)[-1] == 496 * MS and len(stamps(125, 0.5)) == 63
    assert len(stamps(1000, 0.5)) == 501 and stamps(3, 1)[1] == 333_333_333
