"""The GPU's ideal sensor with further samples, its launches on a CPU too: events, and what finds no room."""

import numpy as np
import pytest
import warp as wp
from further_rig import WRONG, random_gaps, sensed, sensor_for, tell

from nodes.event_sensor.cuda.event_list import DeviceEventList
from nodes.event_sensor.cuda.ideal import IdealPasses
from nodes.event_sensor.engines.engine import sensor_struct
from nodes.event_sensor.input.batch import Batch, Size
from nodes.event_sensor.input.between_kernels import between
from nodes.event_sensor.input.further import Further
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.optics.photoreceptor import Photoreceptor
from nodes.event_sensor.optics.trace import Tracer
from nodes.event_sensor.optics.trace_kernels import make_trace_or_count
from nodes.event_sensor.parameters import resolve_sensor
from nodes.event_sensor.sensor import EventSensor

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
    event_list = DeviceEventList(
        engine, struct, layout, (envs, total, channels == 3), False, device, lambda found: None
    )
    event_list.pipeline.grow(room)
    found = []
    for k, gap in enumerate(gaps):
        images = wp.array(gap.frames.ravel(), dtype=wp.float32, device=device)
        lists = gap.further.on(size, device) if len(gap.further.offset) else None
        begin, episodes = np.full(envs, int(k == 0)), np.zeros((2, envs), np.int32)
        batch = Batch(images, images, gap.t, len(gap.t), len(gap.t), gap.start, gap.start, begin, episodes, lists)
        found += tell(event_list.submit(batch, int(gap.t[-1])).result().numpy())
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


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("level", [0.0, 1.0])
def test_the_photoreceptor_counts_and_then_writes(poles, level):
    """The GPU's two launches, made on a CPU: frames, lists and values are those of the CPU's one, to float32."""
    shape = (2, 3, 4)
    gaps = random_gaps(np.random.default_rng(5), shape, 3, 4, 6.0, bad=0.0)
    gaps[1].frames[0, 1, :, 2], gaps[2].further.value[5:9] = np.nan, -1.0
    device = wp.get_device("cpu")
    params = {"bandwidth_hz": 80.0, "bandwidth_level": level, "poles": poles}
    one, two = (Photoreceptor(3, 4, 2, **params) for _ in range(2))
    state = [np.array(values.numpy()) for values in two._state()]
    state = [wp.array(values, device=device) for values in state]
    tracer = Tracer(poles, level > 0, two._receptor, two._chord, device)
    tracer._kernel = make_trace_or_count(poles, level > 0)
    for k, gap in enumerate(gaps):
        lists = gap.further.on(Size(3, 4, 1, 2), device)
        images, fresh = wp.array(gap.frames.ravel(), device=device), np.full(2, k == 0)
        frames, made = one.trace(images, lists, gap.t, gap.start, fresh)
        tracer.begin(images, state)
        stamps, starts = wp.array(gap.t - gap.start, device=device), wp.array(fresh.astype(np.int32), device=device)
        count = tracer._on_gpu([two._receptor, two._chord, starts, stamps, images, between(lists)], state)
        np.testing.assert_allclose(tracer.filtered.numpy(), frames.numpy(), rtol=3e-7)
        if k == 0:
            assert made is None and count == 0
            continue
        assert count == made.offset.size > 200
        assert np.array_equal(tracer._first.numpy(), made.first.numpy())
        assert np.array_equal(tracer._output.offset.numpy()[:count], made.offset.numpy())
        np.testing.assert_allclose(tracer._output.value.numpy()[:count], made.value.numpy(), rtol=3e-7)


@pytest.mark.gpu
def test_a_photoreceptor_is_as_on_a_cpu():
    """An event moves by as much as the last bit of a float32 moves its crossing."""
    gaps = random_gaps(np.random.default_rng(1), (2, 12, 15), 4, 5, 9.0, 0.02)
    a, b = (
        np.array(sorted(sensed(gaps, device=device, bandwidth_hz=200.0)[0], key=lambda e: (e[0], e[2], e[3], e[1])))
        for device in ("cuda:0", "cpu")
    )
    assert len(a) == len(b) > 1000 and np.median(np.abs(a[:, 1] - b[:, 1])) <= 2


@pytest.mark.gpu
@pytest.mark.parametrize("params", [{}, {"refractory_us": 200.0}, {"shot_rate": 100.0, "leak_rate": 10.0}])
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


@pytest.mark.gpu
@pytest.mark.parametrize(("first", "offset", "value", "text"), WRONG)
def test_what_is_wrong_is_named_with_the_events_that_nobody_waits_for(first, offset, value, text):
    """Nothing of it is read, and the calls beside it are what they are without it."""
    none, frames = np.zeros(1, np.int32), np.ones((1, 2, 1, 2), np.float32)
    sensor = EventSensor(1, 2, device="cuda:0")
    sensor.process(frames[:, :1], np.array([100]), none)
    further = Further(np.array(first), np.array(offset), np.array(value))
    with pytest.raises(ValueError, match=text):
        sensor.process_async(frames, np.array([104, 110]), none, further=further).result()
    fine = Further(np.array([0, 1, 1]), np.array([2]), np.array([2.0]))
    waiting = [sensor.process_async(frames, np.array([t + 4, t + 10]), none, further=fine) for t in (110, 120)]
    assert all(len(call.result()) == 2 * int(np.log(2) / 0.2) for call in waiting)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("colour", [False, True])
def test_messages_in_a_row_are_as_one_after_another(device, colour):
    """Also where a pixel has samples in some of them alone, and one has none at all."""
    gaps = random_gaps(np.random.default_rng(8), (1, 12, 15, *((3,) if colour else ())), 4, 5, 9.0)
    gaps[2].further = gaps[2].further.none()
    sensor, none = sensor_for(gaps, device=device), np.zeros(1, np.int32)
    found = tell(sensor.process(gaps[0].frames, gaps[0].t, none, further=gaps[0].further))
    later = [gap.start - gaps[1].start for gap in gaps[1:]]
    joined = Further.in_a_row([gap.further for gap in gaps[1:]], later, wp.get_device(device))
    frames, t = np.concatenate([gap.frames for gap in gaps[1:]], axis=1), np.concatenate([gap.t for gap in gaps[1:]])
    found += tell(sensor.process(frames, t, none, further=joined))
    assert_same(found, sensed(gaps)[0])


def test_messages_in_a_row_whose_lengths_do_not_fit_are_refused():
    one, short = (Further(np.array(first), np.array([2]), np.ones(1)) for first in ([0, 1, 1], [0, 1]))
    lacking = Further(np.array([0, 1, 2]), np.array([2, 3]), np.ones(1))
    for other in (short, lacking):
        with pytest.raises(ValueError, match="in a row have"):
            Further.in_a_row([one, other], [0, 10], wp.get_device("cpu"))
