"""What measuring costs follows the events, not the time they claim to span nor the size of the sensor."""

from __future__ import annotations

import numpy as np
import pytest

from evis.events.measure import Measurement
from evis.events.measure.noise import Noise, neighbours_active


def events(n, width, height, seed):
    """Pixels and polarities at random."""
    rng = np.random.default_rng(seed)
    return (
        rng.integers(0, width, n).astype(np.uint16),
        rng.integers(0, height, n).astype(np.uint16),
        rng.integers(0, 2, n).astype(np.uint8),
    )


def bursts():
    """300 events in 80 ms, every 4 s."""
    rng = np.random.default_rng(1)
    return np.sort(np.concatenate([k * 4_000_000_000 + rng.integers(0, 80_000_000, 300) for k in range(50)]))


def test_searches_follow_the_events(monkeypatch):
    """Of 50 stretches with a handful of events each, few are searched for a rotation, and the rest is said."""
    from evis.events.measure import measurement
    from evis.events.measure.rotation.rotation import nothing

    searched = []
    monkeypatch.setattr(measurement, "measure_rotation", lambda t, *_: searched.append(len(t)) or nothing("none"))
    t = bursts()
    measured = Measurement(346, 260)
    measured.add(t, *events(len(t), 346, 260, 2))
    report = measured.report()
    assert len(searched) <= 3 + len(t) // 5000
    # a burst that lies across the border of two stretches counts in both
    assert len(searched) + report["stretches_left_out"] >= 50


def test_a_rotation_behind_silence_is_searched(monkeypatch):
    """Stretches with too few events to search use nothing up."""
    from evis.events.measure import measurement

    searched = []
    true = measurement.measure_rotation
    monkeypatch.setattr(measurement, "measure_rotation", lambda t, *a: searched.append(len(t)) or true(t, *a))
    t = np.arange(60, dtype=np.int64) * 2_000_000_000
    measured = Measurement(346, 260)
    measured.add(t, *events(len(t), 346, 260, 3))
    assert len(measured._segments) == 59 and measured._searches == 0


@pytest.mark.parametrize("span", [1 << 62, (1 << 63) - 1])
def test_times_that_leap_by_years(span):
    """One window for each event: the noise is that of a stream that was observed nearly all the time."""
    n = 3000
    t = np.linspace(-float(span) * 0.999, float(span) * 0.999, n).astype(np.int64)
    measured = Measurement(1280, 720, rotation=False)
    measured.add(t, *events(n, 1280, 720, 4))
    noise = measured.report()["noise"]
    assert noise["observed_share"] == pytest.approx(1.0, abs=1e-6)
    assert noise["rate_hz"] == pytest.approx(n / (1280 * 720) / ((int(t[-1]) - int(t[0])) * 1e-9), rel=1e-3)


@pytest.mark.parametrize("n", [3, 40, 400])
def test_few_events_count_as_a_whole_image_would(n):
    """Windows that are counted event by event agree with the definition, on whole images."""
    width, height, length = 240, 180, 10_000_000
    noise, quiet, seconds = Noise(width, height), np.zeros((2, height, width), int), np.zeros((height, width), np.int64)
    for seed in range(5):
        x, y, p = events(n, width, height, seed)
        x[: n // 2], y[: n // 2] = x[0] + np.arange(n // 2) % 3, y[0]  # neighbours
        x = np.minimum(x, width - 1)
        noise.add(x, y, p, length)
        counts = np.zeros((2, height, width), int)
        np.add.at(counts, (p, y, x), 1)
        unobserved = neighbours_active(counts.sum(0) > 0)
        quiet += counts * ~unobserved
        seconds += ~unobserved * length
    np.testing.assert_array_equal(noise._quiet, quiet)
    np.testing.assert_array_equal(noise._span_ns - noise._busy_ns, seconds)


def test_a_sensor_that_is_too_large():
    """It is refused with what it would take."""
    with pytest.raises(ValueError, match=r"65535x65535 pixels takes 275 GB.*--size WxH"):
        Measurement(65535, 65535)
