"""The GPU's ideal sensor with further samples, its launches on a CPU too: events, and what finds no room."""

import numpy as np
import pytest
import warp as wp
from further_rig import random_gaps, sensed, sensor_for, tell

from nodes.event_sensor.batch import Batch, Size
from nodes.event_sensor.cuda.ideal import IdealPasses
from nodes.event_sensor.cuda.side import DeviceSide
from nodes.event_sensor.engines import sensor_struct
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.parameters import resolve_sensor

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)]


def passes(gaps, device, room):
    """Events of the passes themselves, with a list that is too short at first."""
    device = wp.get_device(device)
    envs, _, height, width = gaps[0].frames.shape[:4]
    channels = 3 if gaps[0].frames.ndim == 5 else 1
    p = resolve_sensor("test", "ideal", {})
    p["threshold_on"] = p["threshold_off"] = p["threshold"]
    size, layout = Size(height, width, channels, envs), KeyLayout.of(height, width, envs)
    struct = sensor_struct(p, (height, width, channels), layout, 0)
    total = envs * size.pixels
    engine = IdealPasses(total, size.pixels, False, device)
    side = DeviceSide(engine, struct, layout, (envs, total, channels == 3), False, device, lambda found: None)
    side.pipeline.grow(room)
    found = []
    for k, gap in enumerate(gaps):
        images = wp.array(gap.frames.ravel(), dtype=wp.float32, device=device)
        lists = gap.further.on(size, device) if len(gap.further.offset) else None
        begin, episodes = np.full(envs, int(k == 0)), np.zeros((2, envs), np.int32)
        batch = Batch(images, images, gap.t, len(gap.t), len(gap.t), gap.start, gap.start, begin, episodes, lists)
        found += tell(side.submit(batch, int(gap.t[-1])).result().numpy())
    return found


def assert_same(found, expected):
    """The logarithms differ in their last bits, and so a time that lies between two nanoseconds."""
    order = [sorted(events, key=lambda e: (e[0], e[2], e[3], e[4], e[1])) for events in (found, expected)]
    a, b = (np.array(events, np.int64) for events in order)
    assert len(a) > 1000 and np.array_equal(np.delete(a, 1, 1), np.delete(b, 1, 1))
    assert np.abs(a[:, 1] - b[:, 1]).max() <= 1 and (a[:, 1] != b[:, 1]).mean() < 0.01


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("shape", [(3, 4, 5), (1, 2, 9, 3)])
@pytest.mark.parametrize("room", [16, 100_000])
def test_passes_are_as_on_a_cpu(device, shape, room):
    gaps = random_gaps(np.random.default_rng(0), shape, 4, 5, 9.0, 0.05)
    assert_same(passes(gaps, device, room), sensed(gaps)[0])


@pytest.mark.gpu
@pytest.mark.parametrize(
    "params", [{}, {"refractory_us": 200.0}, {"shot_rate": 100.0, "leak_rate": 10.0}, {"bandwidth_hz": 200.0}]
)
def test_sensors_are_as_on_a_cpu(params):
    gaps = random_gaps(np.random.default_rng(1), (2, 12, 15), 4, 5, 9.0, 0.02)
    assert_same(sensed(gaps, device="cuda:0", **params)[0], sensed(gaps, **params)[0])


@pytest.mark.gpu
def test_calls_in_flight_have_their_own_samples():
    gaps = random_gaps(np.random.default_rng(2), (1, 12, 15), 3, 5, 9.0)
    sensor = sensor_for(gaps, device="cuda:0")
    none = np.zeros(1, np.int32)
    waiting = [sensor.process_async(gap.frames, gap.t, none, further=gap.further) for gap in gaps]
    assert_same([e for call in waiting for e in tell(call.result().numpy())], sensed(gaps)[0])
