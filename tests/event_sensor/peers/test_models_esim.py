"""ESIM's rules against crossings computed by hand, and against what its own program was measured to do."""

import numpy as np
import pytest

from nodes.event_sensor.peers import make_model

MS = 1_000_000


def pixel(levels, step_ns=MS, count=1, **params):
    """Events of `count` equal pixels in a row that see exp(levels)."""
    images = np.repeat(np.exp(np.asarray(levels, np.float64)).astype(np.float32)[None, :, None, None], count, 3)
    t = np.arange(len(levels), dtype=np.int64) * step_ns
    return make_model("esim", 1, count, **params).process(images, t, np.zeros(1))


def test_crossing_times_are_linear_in_the_logarithm():
    """0 to 0.5: levels at 2/5 and 4/5; to 1.1: at 1/6, 1/2, 5/6; down to 0.3: 0.8, 0.6, 0.4 at 3/8, 5/8, 7/8."""
    events = pixel([0, 0.5, 1.1, 0.3], threshold=0.2)
    expected = [0.4, 0.8, 1 + 1 / 6, 1.5, 1 + 5 / 6, 2.375, 2.625, 2.875]
    np.testing.assert_allclose(events.t / MS, expected, atol=2e-6)
    assert events.p.tolist() == [1] * 5 + [0] * 3


def test_different_thresholds():
    """Up 1 by 0.3: 0.3, 0.6, 0.9; from 0.9 down by 0.45 to 0: 0.45, and 0 is reached as a float32 sum or not."""
    events = pixel([0, 1.0, 0.01], threshold_on=0.3, threshold_off=0.45)
    np.testing.assert_allclose(events.t / MS, [0.3, 0.6, 0.9, 1 + 0.55 / 0.99], atol=2e-6)


def test_dark_level_is_added_before_the_logarithm():
    images = np.array([0.0, 1.0], np.float32).reshape(1, 2, 1, 1)
    events = make_model("esim", 1, 1, threshold=1.0, dark_level=1e-3).process(images, np.array([0, MS]), np.zeros(1))
    np.testing.assert_allclose(events.t / MS, np.arange(1, 7) / np.log(1001), atol=1e-6)


def test_dead_time_drops_the_event_and_moves_the_reference():
    """5 nat/s and C 0.2 cross every 40 ms; with 50 ms dead every second crossing is dropped: 80 ms."""
    events = pixel(5e-3 * np.arange(2001), threshold=0.2, refractory_us=50_000)
    np.testing.assert_allclose(np.diff(events.t) / MS, 80, atol=1e-3)


def test_a_change_of_less_than_a_millionth_is_passed_over_and_its_level_lost():
    """0.8e-6 a frame: the pixel that climbs so never fires; one that climbs 1.6e-6 a frame does."""
    levels = np.log1p(np.arange(6001) * np.float32(2**-20))
    slow = pixel(levels[:3001], threshold=0.001)
    assert len(pixel(levels[::2], threshold=0.001).t) == 5
    assert len(slow.t) < 3


@pytest.mark.parametrize("rate,expected", [(50, 2.99), (125, 2.05), (250, 1.95), (1000, 1.80)])
def test_threshold_noise_deafens(rate, expected):
    """rpg_esim's core, measured on a ramp of 5 nat/s over 1 s with C 0.2 and sigma 0.05: events a pixel, of 25."""
    events = pixel(5 * np.arange(rate + 1) / rate, 10**9 // rate, 3000, threshold=0.2, threshold_mismatch=0.05)
    assert len(events.t) / 3000 == pytest.approx(expected, abs=0.15)
