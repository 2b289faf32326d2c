"""Rate, noise and sharpness of streams whose statistics are known."""

from __future__ import annotations

import numpy as np
import pytest
from rotating_events import poisson_events

from evis.events.measure import Measurement
from evis.events.measure.noise import neighbours_active
from evis.events.measure.rate import MAX_BINS, Rate
from evis.events.measure.sharpness import dispersion

SIZE = (64, 48)


def measured(events: tuple[np.ndarray, ...], block: int = 7777, **options) -> dict:
    measurement = Measurement(*SIZE, rotation=False, **options)
    for first in range(0, len(events[0]), block):
        measurement.add(*(v[first : first + block] for v in events))
    return measurement.report()


@pytest.mark.parametrize("rate", [0.05, 1.0, 8.0])
def test_noise_of_known_rate(rate):
    """Within five standard deviations of a Poisson count over the time that was observed, busy neighbours or not."""
    events = poisson_events(rate, 20.0, SIZE)
    noise = measured(events)["noise"]
    observed = noise["observed_share"] * 20.0 * SIZE[0] * SIZE[1]
    assert abs(noise["rate_hz"] - rate) < 5 * np.sqrt(rate / observed) + 1e-3 * rate
    assert noise["on_rate_hz"] + noise["off_rate_hz"] == pytest.approx(noise["rate_hz"])
    assert noise["hot_pixels"]["count"] == 0


def test_hot_pixels_are_named_and_left_out():
    """Three pixels at 200 Hz among noise of 0.5 Hz."""
    random = np.random.default_rng(5)
    base = poisson_events(0.5, 10.0, SIZE)
    hot = [(10, 20), (40, 7), (63, 47)]
    t = random.integers(0, 10**10, 2000 * len(hot))
    x, y = (np.repeat([h[i] for h in hot], 2000).astype(np.uint16) for i in (0, 1))
    parts = [np.concatenate(pair) for pair in zip(base, (t, x, y, random.integers(0, 2, len(t)).astype(np.uint8)))]
    order = np.argsort(parts[0], kind="stable")
    noise = measured(tuple(v[order] for v in parts))["noise"]
    assert {(h["x"], h["y"]) for h in noise["hot_pixels"]["worst"]} == set(hot)
    assert noise["hot_pixels"]["worst"][0]["rate_hz"] == pytest.approx(200, rel=0.05)
    assert noise["rate_hz"] == pytest.approx(0.5, rel=0.05)


def test_a_moving_edge_is_no_noise():
    """A column of events that sweeps the image, alone: hardly any event has quiet neighbours."""
    x = np.repeat(np.arange(64), 48)
    y = np.tile(np.arange(48), 64)
    t = x * 10**6 + y
    noise = measured((t.astype(np.int64), x.astype(np.uint16), y.astype(np.uint16), np.ones(len(t), np.uint8)))["noise"]
    assert noise["rate_hz"] == 0


def test_neighbours_against_a_loop():
    """All eight, not the pixel itself, borders included."""
    active = np.random.default_rng(0).random((13, 9)) < 0.15
    for i in range(13):
        for j in range(9):
            around = active[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2].sum() - active[i, j]
            assert neighbours_active(active)[i, j] == (around > 0)


def test_rate_and_its_halves():
    """3 ON and 1 OFF per ms, twice as many in the second half."""
    t = np.concatenate([np.arange(0, 400) * 250_000, 100_000_000 + np.arange(0, 800) * 125_000])
    p = (np.arange(1200) % 4 != 0).astype(np.uint8)
    zero = np.zeros(1200, np.uint16)
    report = measured((t, zero, zero, p))
    span = (t[-1] - t[0]) * 1e-9
    assert report["event_rate_hz"] == pytest.approx(1200 / span)
    assert (report["on"], report["off"]) == (900, 300)
    assert report["on_rate_hz"] == pytest.approx(900 / span)
    values = [v for _, v in report["rate"]["series"]]
    assert values[:10] == [4000.0] * 10 and values[10:19] == [8000.0] * 9
    assert report["rate"]["series"][3][0] == 30_000_000


def test_rate_of_a_long_stream_doubles_its_windows():
    """No event is lost when windows are merged."""
    t = np.arange(100_000) * 10**9
    rate = Rate(10**6)
    for first in range(0, len(t), 1000):
        rate.add(t[first : first + 1000], np.ones(1000, np.uint8))
    report = rate.report()
    assert report["events"] == 100_000 and len(report["rate"]["series"]) <= MAX_BINS
    window = report["rate"]["window_ns"]
    counts = np.array([v * window * 1e-9 for _, v in report["rate"]["series"][:-1]])
    # rates are given to 0.001 / s
    assert counts == pytest.approx(np.histogram(t, np.arange(len(counts) + 1) * window)[0], abs=6e-4 * window * 1e-9)


def test_dispersion():
    """1 for events at random (Poisson), and n - mean for all in one pixel; the two ways of counting agree."""
    random = np.random.default_rng(2)
    x, y = random.integers(0, 64, 60_000), random.integers(0, 48, 60_000)
    assert dispersion(x, y, *SIZE) == pytest.approx(1, abs=5 * np.sqrt(2 / (64 * 48)))
    for n in (50, 5000):
        assert dispersion(np.full(n, 3), np.full(n, 4), *SIZE) == pytest.approx(n - n / (64 * 48))


def test_blocks_do_not_matter():
    """Cut anywhere, the same report."""
    events = poisson_events(3.0, 1.0, SIZE)
    assert measured(events, 997) == measured(events, 10**6)


def test_empty_and_single():
    """No events, one event, all at one time: no rate, no error."""
    empty = Measurement(*SIZE).report()
    assert empty["event_rate_hz"] is None and empty["rotation"]["omega_rad_s"] is None and empty["events"] == 0
    one = np.zeros(1, np.int64), np.zeros(1, np.uint16), np.zeros(1, np.uint16), np.ones(1, np.uint8)
    far = np.zeros(3, np.int64), np.array([5, 20, 40], np.uint16), np.full(3, 9, np.uint16), np.ones(3, np.uint8)
    for events in (one, far):
        report = measured(events)
        assert report["events"] == len(events[0])
        assert report["event_rate_hz"] is None and report["noise"]["rate_hz"] is None


def test_times_that_step_back_and_pixels_outside_are_counted():
    """Neither is lost in silence."""
    t = np.array([10, 20, 15, 30]) * 10**6
    x = np.array([1, 2, 3, 64]).astype(np.uint16)
    report = measured((t, x, x * 0, np.ones(4, np.uint8)))
    assert (report["events"], report["time_steps_back"], report["events_outside"]) == (3, 1, 1)


def test_window_too_short():
    """One clear line."""
    with pytest.raises(ValueError, match="window of 10 ns is too short"):
        Measurement(*SIZE, window_ns=10)


@pytest.mark.parametrize("apart", [10_000_000, 10])
def test_the_end_of_a_stream_is_no_peak(apart):
    """Events at even distances have the same rate everywhere, also where the last one begins a window; three within
    20 ns are not spread over 10 ms.
    """
    rate = Rate(10_000_000)
    rate.add(np.arange(3) * apart, np.ones(3, np.uint8))
    told = rate.report()
    wanted = 1e9 / apart if apart == 10_000_000 else told["event_rate_hz"]
    assert told["rate"]["peak_hz"] == pytest.approx(wanted) and told["rate"]["median_hz"] == pytest.approx(wanted)
