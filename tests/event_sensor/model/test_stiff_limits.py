"""Parameters and sizes at the ends of their ranges, against closed form."""

import math

import numpy as np
import pytest

from nodes.event_sensor.input.timeline import LATEST
from nodes.event_sensor.sensor import EventSensor

MS = 1_000_000
ONE = np.zeros(1, np.int32)
COLUMNS = ("t", "x", "y", "p")


def run(images, t, **params):
    """Events, all of them, of images [T, H, W] or [T] in one message."""
    images = np.asarray(images, np.float32)
    images = images if images.ndim == 3 else images[:, None, None]
    return EventSensor(*images.shape[1:], **params).process(images[None], np.asarray(t, np.int64), ONE)


@pytest.mark.parametrize("frame_ns, frames", [(1, 5000), (1000, 101), (MS, 11), (10 * MS, 2)])
def test_a_leak_of_a_megahertz_fires_every_microsecond(frame_ns, frames):
    """In steps of 1 ns, of its own period, and of ten thousand of them; the phase is the pixel's own."""
    events = run(np.ones(frames), np.arange(frames) * frame_ns, leak_rate=1e6)
    span = (frames - 1) * frame_ns
    assert (np.diff(events.t) == 1000).all() and (events.p == 1).all()
    assert 0 < events.t[0] <= 1000 and span - 1000 < events.t[-1] <= span


def test_a_slow_leak_over_a_gap_of_ten_hours():
    """0.1 Hz for 36,000 s: 3,600 events, 10 s apart to the rounding of the rate in float32."""
    events = run(np.ones(2), [0, 36_000 * 10**9], leak_rate=0.1)
    assert len(events.t) == 3600
    np.testing.assert_allclose(np.diff(events.t), 10 * 10**9, rtol=6e-8)


def test_dead_time_of_a_quarter_of_an_hour_between_frames_hours_apart():
    """L rises by 9 in 1 s and falls and rises by 9 in about 2000 s each; C 0.2, dead for 1000 s.

    An event at 0.2 / 9 s; in reset until 1000.02 s, then 0.2 lower 0.2 / 9 x 1999 s later, and so on.
    """
    corners = np.array([0, 1, 2000, 4000]) * 10**9
    events = run(np.exp([0.0, 9, 0, 9]), corners, refractory_us=1e9)
    want, now = [], 0.2 / 9
    for length in (0, 1999, 2000, 2000):
        now += length * 0.2 / 9 + (1000 if want else 0)
        want.append(now)
    np.testing.assert_allclose(events.t * 1e-9, want, atol=2e-4)
    assert events.p.tolist() == [1, 0, 1, 1]


@pytest.mark.parametrize("size", [200, 300])
def test_more_events_than_the_list_has_room_for(size):
    """All pixels rise by 25.2 thresholds in 1 us and fall again: 25 events each way, 1e12 a second and more."""
    images = np.ones((3, size, size), np.float32)
    images[1] = math.exp(5.05)
    sensor = EventSensor(size, size)
    events = sensor.process(images[None], np.array([0, 1000, 2000]), ONE)
    assert sensor.counts() == {"nonfinite": 0, "clipped": 0, "dropped": 0}
    assert (np.diff(events.t) >= 0).all() and ((events.p == 1) == (events.t <= 1000)).all()
    pixel = (events.y.astype(int) * size + events.x) * 2 + events.p
    assert (np.bincount(pixel, minlength=2 * size * size) == 25).all()


def test_dead_time_of_a_nanosecond():
    """1 ns is 0.00505 of the 5.05 that 1 us brings: 5.05 / (0.2 + 0.00505) = 24.6 events, no two at one time."""
    events = run(np.exp([0, 5.05]), [0, 1000], refractory_us=0.001)
    assert len(events.t) == 24
    np.testing.assert_allclose(np.diff(events.t), 205.05 / 5.05, atol=1)


@pytest.mark.parametrize("crossing", ["frame", "linear"])
@pytest.mark.parametrize("c", [0.01, 0.2, 5.0])
def test_a_signal_that_swings_by_whole_thresholds_fires_all_of_them(crossing, c):
    """Pixel k goes from 0 to k C and back, 100 times, so that each turn stands at a level: k ON and k OFF a cycle.

    k C is rounded to float32 as light: half of the levels lie beyond what the sample shows.
    """
    k = np.arange(1, 9)
    images = np.exp(np.where(np.arange(201)[:, None] % 2, k * c, 0.0))[:, None, :]
    events = run(images, np.arange(201) * MS, threshold=c, crossing=crossing)
    for on in (0, 1):
        assert np.bincount(events.x[events.p == on], minlength=8).tolist() == (100 * k).tolist()


@pytest.mark.parametrize("seed", [2**63 - 1, -(2**63), 2**64 - 2])
def test_environments_of_the_last_seeds_are_single_runs(seed):
    """seed + k wraps round at 2^64 as a single run's seed does."""
    params = {"shot_rate": 2000.0, "shot_white": 100.0, "timestamp_jitter_us": 5.0}
    images, t = np.ones((3, 11, 4, 5), np.float32), np.arange(11) * MS
    together = EventSensor(4, 5, 3, seed=seed, **params).process(images, t, np.zeros(3, np.int32))
    for k in range(3):
        alone = EventSensor(4, 5, seed=seed + k, **params).process(images[:1], t, ONE)
        part = slice(*together.env_offsets[k : k + 2])
        assert len(alone.t) > 100
        assert all(getattr(together, c)[part].tobytes() == getattr(alone, c).tobytes() for c in COLUMNS)


def test_a_thousand_environments_are_single_runs():
    """1024 of them, with noise, a queue and jitter, in two messages, one of them reset in between."""
    params = {"shot_rate": 50.0, "readout_rate": 2e5, "timestamp_jitter_us": 5.0}
    rng = np.random.default_rng(0)
    images = np.exp(np.cumsum(rng.normal(0, 0.3, (1024, 6, 5, 6)), 1)).astype(np.float32)
    t, cut = np.arange(6) * MS, [slice(0, 3), slice(3, 6)]
    episodes = [np.zeros(1024, np.int32), np.zeros(1024, np.int32)]
    episodes[1][511] = 1
    sensor = EventSensor(5, 6, 1024, seed=3, **params)
    together = [sensor.process(images[:, part], t[part], e) for part, e in zip(cut, episodes)]
    for k in (0, 511, 1023):
        alone = EventSensor(5, 6, seed=3 + k, **params)
        for events, part, e in zip(together, cut, episodes):
            want = alone.process(images[k : k + 1, part], t[part], e[k : k + 1])
            mine = slice(*events.env_offsets[k : k + 2])
            assert len(want.t) > 20
            assert all(getattr(events, c)[mine].tobytes() == getattr(want, c).tobytes() for c in COLUMNS)


def test_more_noise_than_a_message_can_hold_is_refused_at_once():
    """A megahertz for an hour is 3.6e9 events, which would wrap a 32-bit count; 1e3 of dead time make it 3.6e6."""
    t = np.array([0, 3600 * 10**9])
    for fault in ({"leak_rate": 1e6}, {"shot_rate": 1e6}, {"hot_pixel_fraction": 1.0, "hot_pixel_rate": 1e6}):
        with pytest.raises(ValueError, match=r"leak and noise make 1e\+06 events per second in 1 x 1 pixels, too many"):
            run(np.full(2, 0.1), t, **fault)
    assert len(run(np.ones(2), t, leak_rate=1e6, refractory_us=1e6).t) == 3600


def test_stamps_too_far_from_zero_are_refused():
    """A waiting time of up to 4e18 ns is added to them; 5e18 ns are 158 years."""
    images = np.ones((1, 2, 1, 1), np.float32)
    for t in ((LATEST, LATEST + 1), (-LATEST - 1, -LATEST)):
        with pytest.raises(ValueError, match="they must lie within"):
            EventSensor(1, 1, shot_rate=5.0).process(images, np.array(t), ONE)
    EventSensor(1, 1, shot_rate=5.0).process(images, np.array([LATEST - 1, LATEST]), ONE)
