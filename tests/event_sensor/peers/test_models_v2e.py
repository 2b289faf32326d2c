"""v2e's rules against cases computed by hand."""

import math

import numpy as np
import pytest

from nodes.event_sensor.peers import make_model

MS = 1_000_000


def run(images, t, **params):
    """Events of images [K, N], one row of N pixels."""
    images = np.asarray(images, np.float32)[None, :, None]
    return make_model("v2e", 1, images.shape[3], **params).process(images, np.asarray(t, np.int64), np.zeros(1))


def test_stamps_are_on_the_grid_of_the_busiest_pixel():
    """Alone a pixel with one event has it at the frame, 8 ms; beside one with 100 events at 0.08 ms."""
    quiet = np.exp([[0.0], [0.25]])
    assert run(quiet, [0, 8 * MS]).t.tolist() == [8 * MS]
    beside = run(np.hstack([quiet, np.exp([[0.0], [20.05]])]), [0, 8 * MS])
    assert beside.t[beside.x == 0].tolist() == [80_000]
    assert beside.t[beside.x == 1].tolist() == [80_000 * k for k in range(1, 101)]


def test_three_against_two_events():
    """n_max = 3 in 6 ms: stamps 2, 4, 6 ms; the pixel with two OFF events has the first two of them."""
    events = run(np.exp([[0.0, 0.0], [0.65, -0.45]]), [0, 6 * MS])
    assert sorted(zip(events.t // MS, events.x, events.p)) == [(2, 0, 1), (2, 1, 0), (4, 0, 1), (4, 1, 0), (6, 0, 1)]


def test_the_residual_is_kept():
    """0.151 a frame against 0.2: a crossing in frames 2, 3 and 4, none in frame 1."""
    assert run(np.exp(0.151 * np.arange(5))[:, None], np.arange(5) * MS).t.tolist() == [2 * MS, 3 * MS, 4 * MS]


def test_lin_log_is_linear_below_20():
    """DN 0 to 20 is 0 to ln 20 in a straight line, ln above: 0 -> 10 -> 20 -> 80 is 1.498, 1.498, 1.386."""
    dn = np.array([0, 10, 20, 80])[:, None]
    events = run(dn, np.arange(4) * MS, linlog=True, shot_white=255.0, threshold=0.1)
    counts = np.diff([0, *np.searchsorted(events.t, np.arange(1, 4) * MS, "right")])
    levels = np.array([0, 0.5 * math.log(20), math.log(20), math.log(80)])
    assert counts.tolist() == np.diff(np.floor(levels / 0.1)).astype(int).tolist() == [14, 15, 14]


def test_low_pass_is_an_euler_step_that_falls_with_intensity():
    """eps = (DN + 20) / 275 * dt / tau of a step of 3 at 255 DN and at 0.1 of it, against thresholds of 0.01."""
    tau = 1 / (2 * math.pi * 20.0)
    for white, bright in ((math.exp(3.0), 1.0), (10 * math.exp(3.0), (25.5 + 20) / 275)):
        events = run([[1.0], [math.exp(3.0)]], [0, MS], bandwidth_hz=20.0, shot_white=white, threshold=0.01)
        assert len(events.t) == math.floor(3.0 * bright * 1e-3 / tau / 0.01)


def test_a_low_pass_beyond_the_frame_rate_is_none():
    """eps is cut at 1."""
    assert len(run([[1.0], [math.e]], [0, MS], bandwidth_hz=1e6, shot_white=1.0, threshold=0.3).t) == 3


def test_dead_time_puts_the_event_off():
    """5 nat/s, C 0.2, 50 ms dead: v2e's events are 50 ms apart, to the grid of the frames (1 ms) or finer."""
    events = run(np.exp(5e-3 * np.arange(2001))[:, None], np.arange(2001) * MS, refractory_us=50_000)
    apart = np.diff(events.t) / MS
    assert 50 <= apart.mean() <= 51 and apart.min() > 50


def test_dead_time_shorter_than_the_grid_is_not_looked_at():
    """Three events in 3 ms are 1 ms apart: 0.9 ms of dead time drops none, 1.1 ms the middle one, which comes back."""
    levels = np.exp([[0.0], [0.65], [0.65]])
    assert len(run(levels, np.arange(3) * 3 * MS, refractory_us=900).t) == 3
    assert run(levels, np.arange(3) * 3 * MS, refractory_us=1100).t.tolist() == [MS, 3 * MS, 6 * MS]


def test_leak_lowers_the_remembered_value():
    """5 Hz at C 0.2: 1 nat/s, so an ON event every 200 ms in constant light; frames at 1 kHz."""
    events = run(np.ones((2001, 3)), np.arange(2001) * MS, leak_rate=5.0)
    assert np.bincount(events.x).tolist() in ([9] * 3, [10] * 3) and (events.p == 1).all()
    assert np.abs(np.diff(events.t[events.x == 0]) / MS - 200).max() <= 1


@pytest.mark.parametrize("rate_hz,frame_ms", [(50.0, 1), (50.0, 10)])
def test_shot_noise_has_its_rate_while_rate_times_dt_is_small(rate_hz, frame_ms):
    """In the dark (20 DN of 275): rate (1 - 0.75 * 20 / 275), half of it ON. Five standard deviations."""
    n, frames = 2000, 200
    events = run(np.full((frames + 1, n), 1e-9), np.arange(frames + 1) * frame_ms * MS, shot_rate=rate_hz)
    expected = n * frames * frame_ms * 1e-3 * rate_hz * (1 - 0.75 * 20 / 275)
    assert abs(len(events.t) - expected) < 5 * math.sqrt(expected)
    assert abs((events.p == 1).sum() - expected / 2) < 5 * math.sqrt(expected / 2)
    assert (events.t % (frame_ms * MS) == 0).all()


def test_thresholds_differ_from_pixel_to_pixel_and_stay():
    """A step of 10 nats: 10 / C events, C normal with the floor; ON and OFF apart; the same on every repetition."""
    n = 4000
    up, down = np.full((1, n), math.exp(10.0)), np.ones((1, n))
    images = np.vstack([down, up, up, down, up])
    t = np.arange(5) * MS
    events = run(images, t, threshold=0.2, threshold_mismatch=0.05)
    counts = [np.bincount(events.x[(events.t > a) & (events.t <= a + MS)], minlength=n) for a in (0, 3 * MS)]
    estimate = 10.0 / (counts[0] + 0.5)
    assert estimate.mean() == pytest.approx(0.2, abs=0.004) and estimate.std() == pytest.approx(0.05, abs=0.004)
    # The OFF step leaves a residual of one OFF threshold at most, and that is never as much as 0.5.
    assert (np.abs(counts[0] - counts[1]) * estimate).max() < 0.5
