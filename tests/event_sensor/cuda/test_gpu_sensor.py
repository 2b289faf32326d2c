"""The sensor on a CUDA device: the CPU's events to the byte, device arrays in and out, calls in flight."""

import numpy as np
import pytest
import warp as wp

from nodes.event_sensor.sensor import EventSensor

pytestmark = pytest.mark.gpu
MS = 1_000_000
ALL_FAULTS = {
    "threshold_mismatch": 0.03, "refractory_us": 300, "leak_rate": 5, "leak_jitter": 0.2, "shot_rate": 20,
    "shot_white": 10, "hot_pixel_fraction": 0.05, "hot_pixel_rate": 200, "defocus_px": 0.8,
}  # fmt: skip
SAME = {
    "ideal": {},
    "frame stamps": {"crossing": "frame"},
    "monotone": {"crossing": "monotone"},
    "defocus": {"defocus_px": 0.7},
    "leak": {"leak_rate": 300},
    "six faults": ALL_FAULTS,
    "cap": {"event_cap": 1},
    "the paper's ideal": {"model": "evis-paper"},
    "the paper": {"model": "evis-paper", "threshold_mismatch": 0.03, "refractory_us": 300, "shot_rate": 20},
}  # fmt: skip


def walk(seed, *shape):
    return np.exp(np.cumsum(np.random.default_rng(seed).normal(0, 0.4, shape), 1)).astype(np.float32)


def run(frames, device, a_call=5, **parameters):
    sensor = EventSensor(
        *frames.shape[2:4], len(frames), channels=3 if frames.ndim == 5 else 1, device=device, **parameters
    )
    t = np.arange(frames.shape[1], dtype=np.int64) * MS
    episodes = np.zeros(len(frames), np.int32)
    parts = [sensor.process(frames[:, k : k + a_call], t[k : k + a_call], episodes) for k in range(0, len(t), a_call)]
    parts.append(sensor.flush())
    return parts, sensor


@pytest.mark.parametrize("name", SAME)
def test_the_same_events_as_on_a_cpu(name):
    frames = walk(0, 3, 32, 40, 50)
    frames[:, 16:] = frames[:, 15::-1]  # every signal comes back to its old values
    (cpu, of_cpu), (gpu, of_gpu) = (run(frames, d, **SAME[name]) for d in ("cpu", "cuda"))
    for a, b in zip(cpu, gpu):
        assert np.array_equal(a.env_offsets, b.env_offsets)
        for column in ("t", "x", "y", "p"):
            assert getattr(a, column).tobytes() == getattr(b, column).tobytes()
    assert of_cpu.counts() == of_gpu.counts()
    assert sum(len(e.t) for e in cpu) > 10_000


@pytest.mark.parametrize("poles", [1, 2])
def test_noise_of_the_photoreceptor_agrees(poles):
    """exp and ln end on another last bit: where float32 light then does, a level is crossed some us later."""
    frames = walk(3, 2, 16, 20, 24)
    given = {
        "bandwidth_hz": 300.0, "bandwidth_poles": poles, "bandwidth_level": 0.5, "photoreceptor_noise": 0.1,
        "photoreceptor_noise_level": 0.3, "dark_level": 0.01,
    }  # fmt: skip
    made = []
    for device in ("cpu", "cuda"):
        parts, _ = run(frames, device, **given)
        made.append(np.stack([np.concatenate([getattr(e, n) for e in parts]).astype(np.int64) for n in "yxpt"]))
    a, b = (one[:, np.lexsort(one[::-1])] for one in made)
    assert a.shape == b.shape and a.shape[1] > 3000 and (a[:3] == b[:3]).all()
    late = np.abs(a[3] - b[3])
    assert np.median(late) <= 2 and late.max() < 50_000


@pytest.mark.parametrize("crossing", ["cubic", "hermite"])
def test_curves_agree_to_a_nanosecond(crossing):
    """Newton's method ends on another last bit where a curve is nearly level."""
    t = np.arange(32) * MS
    phase = np.random.default_rng(1).random((40, 50)) * 6.28
    angle = 2 * np.pi * 40 * t[:, None, None] / 1e9 + phase
    frames, slopes = np.exp(np.sin(angle)), 2 * np.pi * 40 * np.cos(angle)
    more = {"dlog_dt": slopes[None].astype(np.float32)} if crossing == "hermite" else {}
    cpu, gpu = (
        EventSensor(40, 50, crossing=crossing, device=d).process(
            frames[None].astype(np.float32), t, np.zeros(1, np.int32), **more
        )
        for d in ("cpu", "cuda")
    )
    order = [np.lexsort((e.t, e.p, e.x, e.y)) for e in (cpu, gpu)]
    for column in ("x", "y", "p"):
        assert np.array_equal(getattr(cpu, column)[order[0]], getattr(gpu, column)[order[1]])
    assert np.abs(cpu.t[order[0]] - gpu.t[order[1]]).max() <= 1


def test_colour_of_warp_is_colour_of_numpy():
    frames = walk(2, 2, 12, 20, 30, 3)
    t, episodes = np.arange(12) * MS, np.zeros(2, np.int32)
    on_device = wp.array(frames, dtype=wp.vec3f, device="cuda")
    cpu = EventSensor(20, 30, 2, channels=3).process(frames, t, episodes)
    gpu = EventSensor(20, 30, 2, channels=3, device="cuda").process(on_device, t, episodes)
    for column in ("t", "x", "y", "p", "c"):
        assert np.array_equal(getattr(cpu, column), getattr(gpu, column))


class Borrowed:
    """Device memory of another library."""

    def __init__(self, array):
        self.shape, self.array = array.shape, array
        self.__cuda_array_interface__ = {
            "shape": array.shape, "typestr": "<f4", "data": (array.ptr, True), "version": 3, "strides": None,
        }  # fmt: skip


def test_frames_and_events_stay_on_the_device():
    frames = walk(3, 1, 24, 40, 50)
    t, episodes = np.arange(24) * MS, np.zeros(1, np.int32)
    want = EventSensor(40, 50).process(frames, t, episodes)
    sensor = EventSensor(40, 50, device="cuda")
    images = [wp.array(frames[:, k : k + 3], device="cuda") for k in range(0, 24, 3)]
    waiting, parts = [], []
    for k, image in enumerate(images):
        if len(waiting) == 4:
            parts.append(waiting.pop(0).result().copy())
        waiting.append(sensor.process_async(Borrowed(image), t[3 * k : 3 * k + 3], episodes))
    parts += [w.result().copy() for w in waiting]
    assert all(part.t.device.is_cuda for part in parts)
    for column in ("t", "x", "y", "p"):
        got = np.concatenate([getattr(part, column).numpy() for part in parts])
        assert np.array_equal(got, getattr(want, column))


def test_every_sensor_has_events_that_stay_on_the_device():
    frames = walk(4, 1, 8, 20, 30)
    t, episodes = np.arange(8) * MS, np.zeros(1, np.int32)
    for parameters in ({"shot_rate": 100.0}, {"timestamp_jitter_us": 5.0}, {"defocus_px": 0.5}):
        want = EventSensor(20, 30, device="cuda", **parameters).process(frames, t, episodes)
        got = EventSensor(20, 30, device="cuda", **parameters).process_async(frames, t, episodes).result()
        assert got.t.device.is_cuda and np.array_equal(got.t.numpy(), want.t)


def test_state_bytes_are_as_the_docstring_says():
    assert EventSensor(20, 30, 2, device="cuda").state_bytes == 36
    assert EventSensor(20, 30, 2, device="cuda", model="evis-paper").state_bytes == 64


def test_device_memory_of_another_type_is_refused():
    array = Borrowed(wp.zeros((1, 1, 2, 2), dtype=wp.float64, device="cuda"))
    array.__cuda_array_interface__["typestr"] = "<f8"
    with pytest.raises(ValueError, match="expected float32"):
        EventSensor(2, 2, device="cuda").process(array, np.zeros(1, np.int64), np.zeros(1, np.int32))
