"""Marks of signal and noise: against what is known of the light, and without a trace in the events themselves."""

import numpy as np
import pytest

from nodes.event_sensor.sensor import EventSensor

MS = 1_000_000
FAULTS = {
    "ideal": {},
    "mismatch": {"threshold_mismatch": 0.02, "refractory_us": 50.0},
    "drift": {"leak_rate": 8.0, "shot_rate": 30.0},
    "coin": {"leak_rate": 8.0, "leak_model": "bernoulli", "event_cap": 3},
    "hot": {"hot_pixel_fraction": 0.1, "hot_pixel_rate": 200.0, "leak_rate": 8.0, "crossing": "frame"},
    "curve": {"shot_rate": 30.0, "crossing": "cubic", "refractory_us": 100.0},
    "readout": {"shot_rate": 30.0, "leak_rate": 8.0, "timestamp_jitter_us": 30.0, "readout_rate": 2e5},
    "paper": {"model": "evis-paper", "crossing": "frame", "leak_rate": 8.0, "shot_rate": 30.0},
}
QUIET = ("ideal", "mismatch")


def video(envs: int = 2, channels: int = 1) -> np.ndarray:
    """Light that swings in every pixel by its own phase."""
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, (envs, 1, 10, 13, channels))
    swing = np.exp(0.8 * np.sin(np.arange(24)[None, :, None, None, None] / 5 + phase)).astype(np.float32)
    return swing[..., 0] if channels == 1 else swing


def packets(frames: np.ndarray, marked: bool, **parameters):
    """Events of frames 1 ms apart in three messages, and what was held back."""
    envs, count, height, width = frames.shape[:4]
    channels = 3 if frames.ndim == 5 else 1
    sensor = EventSensor(height, width, envs, channels=channels, seed=3, marked=marked, **parameters)
    parts = np.split(np.arange(count), 3)
    made = [sensor.process(frames[:, k], (k + 1) * MS, np.zeros(envs, np.int32)) for k in parts]
    return [*made, sensor.flush()]


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("name", FAULTS)
def test_marks_change_no_byte_of_the_events(name, channels):
    frames = video(channels=channels)
    plain, marked = packets(frames, False, **FAULTS[name]), packets(frames, True, **FAULTS[name])
    assert sum(len(p.t) for p in plain) > 500
    for a, b in zip(plain, marked):
        for column in "txypc":
            one, other = getattr(a, column), getattr(b, column)
            assert (one is None and other is None) or one.tobytes() == other.tobytes()
        assert np.array_equal(a.env_offsets, b.env_offsets)
        assert a.signal is None and b.signal.dtype == np.uint8 and len(b.signal) == len(b.t)


@pytest.mark.parametrize("name", FAULTS)
def test_in_constant_light_everything_is_noise_and_without_noise_everything_is_signal(name):
    still = np.concatenate(
        [p.signal for p in packets(np.full((2, 300, 10, 13), 0.3, np.float32), True, **FAULTS[name])]
    )
    moved = np.concatenate([p.signal for p in packets(video(), True, **FAULTS[name])])
    if name in QUIET:
        assert len(still) == 0 and moved.all() and len(moved)
    else:
        assert len(still) > 100 and not still.any()
        assert 0.5 < moved.mean() < 1.0


@pytest.mark.parametrize("name", FAULTS)
def test_a_call_that_is_begun_has_the_marks_of_one_that_is_done(name):
    frames, t, none = video(), np.arange(1, 25) * MS, np.zeros(2, np.int32)
    sensors = [EventSensor(10, 13, 2, seed=3, marked=True, **FAULTS[name]) for _ in range(2)]
    done, begun = sensors[0].process(frames, t, none), sensors[1].process_async(frames, t, none).result()
    out = {column: np.full(len(begun), 7, dtype) for column, dtype in sensors[1].columns().items()}
    sensors[1].read_call(begun, out)
    assert len(begun) > 100
    for column, values in out.items():
        assert np.array_equal(values, getattr(done, column))


@pytest.mark.parametrize("crossing", ["linear", "frame"])
@pytest.mark.parametrize(("slope", "signal"), [(4.0, 1), (-9.0, 1), (0.5, 0), (1.9, 0), (2.1, 1)])
def test_a_crossing_belongs_to_what_moves_the_pixel_faster(crossing, slope, signal):
    """ln I rises at `slope` per second, the leak of 10 Hz x 0.2 at 2 per second."""
    t = np.arange(200)
    light = np.exp(slope * t * 1e-3)[None, :, None, None].astype(np.float32)
    sensor = EventSensor(1, 1, marked=True, leak_rate=10.0, shot_rate=1e-6, crossing=crossing)
    events = sensor.process(light, (t + 1) * MS, np.zeros(1, np.int32))
    wanted = events.p == 1 if slope > 0 else events.p == 0
    assert len(events.t) >= 2 and wanted.all() and (events.signal == signal).all()


def test_as_many_events_are_noise_as_shot_noise_makes():
    """Poisson, 100 Hz thinned by 1 - I / white, in light that swings by far more than a threshold."""
    frames = np.tile(video(1), (1, 1, 8, 8))[:, :, :64, :64]
    sensor = EventSensor(64, 64, marked=True, shot_rate=100.0, shot_white=3.0, leak_rate=1e-6)
    events = sensor.process(frames, np.arange(1, 25) * MS, np.zeros(1, np.int32))
    mean = (frames[:, 1:] + frames[:, :-1]) / 2
    expected = float((100.0 * 1e-3 * (1 - mean / 3.0)).sum())
    noise = int((events.signal == 0).sum())
    assert abs(noise - expected) < 5 * np.sqrt(expected) and expected > 1000
    # The others follow the light: of one pixel's swing up, none is OFF.
    rising = (frames[0, 1:] > frames[0, :-1])[np.clip((events.t - 1) // MS - 1, 0, 22), events.y, events.x]
    made = events.signal == 1
    assert ((events.p == 1) == rising)[made].all() and not ((events.p == 1) == rising)[~made].all()
