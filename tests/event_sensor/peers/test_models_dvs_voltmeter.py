"""DVS-Voltmeter: straight lines without noise, and the laws of Brownian first passages with it."""

import math

import numpy as np
import pytest
from scipy import stats

from nodes.event_sensor.peers import make_model

MS = 1_000_000
STILL = {"k2": 0.0, "k3": 0.0, "k4": 0.0, "k5": 0.0, "k6": 0.0}


def run(images, t, **params):
    """Events of images [K, N], one row of N pixels; the luminance is in DN."""
    images = np.asarray(images, np.float32)[None, :, None]
    sensor = make_model("dvs_voltmeter", 1, images.shape[3], shot_white=255.0, **{**STILL, **params})
    return sensor.process(images, np.asarray(t, np.int64), np.zeros(1))


def test_without_noise_voltage_is_a_straight_line():
    """10 to 20 DN with k1 = 5: 5 * 10 / 15 = 3.33 thresholds in 1 ms; to 9 DN with 0.33 kept: 3 OFF."""
    events = run([[10], [20], [9]], np.arange(3) * MS, k1=5.0)
    up, down = 5 * 10 / 15, 5 * 11 / 14.5
    expected = [1 / up, 2 / up, 3 / up, *(1 + (1 / 3 + k) / down for k in (1, 2, 3))]
    np.testing.assert_allclose(events.t / MS, expected, atol=2e-6)
    assert events.p.tolist() == [1, 1, 1, 0, 0, 0]


def test_threshold_sets_k1_and_k2_is_the_dark_level():
    """C 0.25 is k1 = 4; k2 = 5 DN: 4 * 10 / 20 = 2 thresholds, the second one at the frame's end and not before it."""
    assert run([[10], [20]], [0, MS], threshold=0.25, k2=5.0).t.tolist() == [MS // 2]
    assert len(run([[10], [20.1]], [0, MS], threshold=0.25, k2=5.0).t) == 2


def test_a_jump_is_bounded_by_the_midpoint_rule():
    """e^20 : 1 gives 2 k1 = 10 thresholds instead of 100."""
    assert len(run([[1e-3], [1e-3 * math.exp(20)]], [0, MS], k1=5.0).t) == 9


def test_leak_is_a_drift_in_us():
    """k4 = 1e-5 per us and k5 = 1e-7 per us and DN at 100 DN: 2e-5 per us, an event every 50 ms."""
    events = run(np.full((1001, 1), 100), np.arange(1001) * MS, k4=1e-5, k5=1e-7)
    np.testing.assert_allclose(np.diff(events.t) / MS, 50, atol=1e-3)
    assert len(events.t) in (19, 20) and (events.p == 1).all()


def test_first_passage_with_drift_is_inverse_gaussian():
    """mu = 1e-3 per us, sigma = 0.01 per sqrt(us): mean 1000 us, shape 1 / sigma^2 = 10,000 us, ON in all but e^-20."""
    n = 20_000
    events = run(np.full((2, n), 100), [0, 50 * MS], k4=1e-3, k6=0.01)
    _, first = np.unique(events.x, return_index=True)
    waits = events.t[first] / 1e3
    assert len(waits) == n and (events.p[first] == 1).all()
    assert waits.mean() == pytest.approx(1000, abs=5 * math.sqrt(1000**3 / 10_000 / n))
    assert waits.var() == pytest.approx(1000**3 / 10_000, rel=0.05)
    law = stats.invgauss(mu=1000 / 10_000, scale=10_000)
    assert stats.kstest(waits, law.cdf).pvalue > 1e-4


def test_event_rate_is_the_drift():
    """A renewal process of mean 1 / mu: 50 events in 50 ms at 1e-3 per us."""
    n = 4000
    events = run(np.full((2, n), 100), [0, 50 * MS], k4=1e-3, k6=0.01)
    # Renewal theory: mu t + (cv^2 - 1) / 2, cv^2 = sigma^2 / mu = 0.1; standard deviation sqrt(5) a pixel.
    assert len(events.t) / n == pytest.approx(50 + (0.1 - 1) / 2, abs=5 * math.sqrt(5 / n))


def test_without_drift_both_polarities_come_alike_and_late():
    """Levy law with scale 1 / sigma^2: half of the first passages are after 1 / (sigma^2 z^2), z the 3/4 quantile."""
    n, sigma = 20_000, 0.05
    median = 1 / (sigma**2 * stats.norm.ppf(0.75) ** 2)
    events = run(np.full((2, n), 100), [0, round(median * 1e3)], k6=sigma)
    _, first = np.unique(events.x, return_index=True)
    assert len(first) == pytest.approx(n / 2, abs=5 * math.sqrt(n / 4))
    assert (events.p[first] == 1).mean() == pytest.approx(0.5, abs=5 / math.sqrt(4 * len(first)))


@pytest.mark.parametrize("drift", [2e-4, -2e-4, 1e-7])
def test_which_threshold_comes_first(drift):
    """P(ON) = (e^x - 1) / (e^x - e^-x), x = 2 mu / sigma^2, for thresholds at 1 and -1 (the paper's eq. for p)."""
    n, sigma = 40_000, 0.02
    x = 2 * drift / sigma**2
    expected = math.expm1(x) / (math.exp(x) - math.exp(-x))
    events = run(np.full((2, n), 100), [0, 40 * MS], k4=drift, k6=sigma)
    _, first = np.unique(events.x, return_index=True)
    assert (events.p[first] == 1).mean() == pytest.approx(expected, abs=5 * math.sqrt(0.25 / len(first)) + 2e-3)


def test_photon_noise_falls_with_light():
    """sigma = k3 / sqrt(L): at a sixteenth of the light the same happens in a sixteenth of the time."""
    counts = [len(run(np.full((2, 4000), dn), [0, ms * MS], k3=0.1).t) for dn, ms in ((100, 400), (6.25, 25))]
    assert counts[0] > 10_000 and counts[1] == pytest.approx(counts[0], rel=0.03)
    assert len(run(np.full((2, 4000), 6.25), [0, 400 * MS], k3=0.1).t) > 4 * counts[0]
