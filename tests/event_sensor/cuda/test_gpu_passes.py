"""The launches of the GPU's ideal sensor, on a CPU too: events against numpy in float64, room, calls in flight."""

import numpy as np
import pytest
import warp as wp

from nodes.event_sensor.cuda import order_kernels, sort_kernels
from nodes.event_sensor.cuda.event_list import DeviceEventList
from nodes.event_sensor.cuda.ideal import IdealPasses
from nodes.event_sensor.engines.engine import sensor_struct
from nodes.event_sensor.input.batch import Batch
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.parameters import resolve_sensor
from nodes.event_sensor.readout.device_events import CALLS

MS = 1_000_000
C_ON, C_OFF = 0.2, 0.23
DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)]


class Passes:
    """The ideal sensor on a device, call by call. frames: float32 [E, K, H, W]."""

    def __init__(self, device, height, width, envs=1, crossing="linear", defer=False):
        self.device = wp.get_device(device)
        p = resolve_sensor("test", "ideal", {"crossing": crossing})
        p["threshold_on"], p["threshold_off"] = C_ON, C_OFF
        layout, size = KeyLayout.of(height, width, envs), height * width
        sensor = sensor_struct(p, (height, width, 1), layout, 0)
        frame = crossing == "frame"
        passes = IdealPasses(envs * size, size, frame, self.device)
        self.found = []
        self.event_list = DeviceEventList(
            passes, sensor, layout, (envs, envs * size, False), frame, self.device, self._count
        )  # fmt: skip
        self.stamp = None
        self.defer = defer

    def _count(self, found):
        self.found.append(found.copy())

    def submit(self, frames, t):
        images = wp.array(np.ascontiguousarray(frames), dtype=wp.float32, device=self.device)
        begin = np.full(len(frames), int(self.stamp is None))
        base = int(t[0]) if self.stamp is None else self.stamp
        self.stamp = int(t[-1])
        batch = Batch(images, images, t, len(t), len(t), base, base, begin, np.zeros((2, len(frames)), np.int32))
        return self.event_list.submit(batch, self.stamp, self.defer)

    def run(self, frames, t, a_call):
        """Columns t, y, x, p of one environment after the other, all calls in flight that may be."""
        parts, waiting = [], []
        for first in range(0, len(t), a_call):
            if len(waiting) == CALLS:
                parts.append(waiting.pop(0).result().numpy())
            waiting.append(self.submit(frames[:, first : first + a_call], t[first : first + a_call]))
        parts += [pending.result().numpy() for pending in waiting]
        envs = range(len(frames))
        return [np.concatenate([columns(e, slice(*e.env_offsets[k : k + 2])) for e in parts]) for k in envs]


def columns(events, part):
    return np.stack([a[part].astype(np.int64) for a in (events.t, events.y, events.x, events.p)], 1)


def expected(frames, t, frame=False):
    """Events of [K, H, W] in float64: whole numbers of thresholds from the first frame; bad samples are held."""
    events = []
    for y, x in np.ndindex(frames.shape[1:]):
        up = down = 0
        base = last = None
        for k, v in enumerate(frames[:, y, x].astype(np.float64)):
            if not np.isfinite(v):
                continue
            now = np.log(v)
            if base is None:
                base = last = now
                continue
            reference = base + up * C_ON - down * C_OFF
            delta = now - reference
            step = C_ON if delta > 0 else -C_OFF
            n = int((abs(delta) + 2.0**-21) / abs(step))
            for j in range(1, n + 1):
                part = np.clip((reference + j * step - last) / (now - last), 0, 1)
                ns = int(np.floor(part * (t[k] - t[k - 1]) + 0.5))
                events.append((t[k] if frame else t[k - 1] + max(ns, 1), y, x, int(delta > 0)))
            up, down = (up + n, down) if delta > 0 else (up, down + n)
            last = now
    events.sort(key=lambda e: e[:3])
    return np.array(events, np.int64).reshape(-1, 4)


def walk(rng, *shape, sigma=0.4):
    return np.exp(np.cumsum(rng.normal(0, sigma, shape), 1)).astype(np.float32)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("defer", [False, True])
@pytest.mark.parametrize("crossing", ["linear", "frame"])
def test_events_are_those_of_float64_numpy(device, crossing, defer):
    rng = np.random.default_rng(0)
    frames = walk(rng, 3, 24, 9, 13)
    frames[rng.random(frames.shape) < 0.01] = np.nan
    frames[:, 0] = 1  # a good first sample everywhere
    t = np.arange(1, 25, dtype=np.int64) * MS
    got = Passes(device, 9, 13, 3, crossing, defer).run(frames, t, 4)
    for e in range(3):
        assert np.array_equal(got[e], expected(frames[e], t, crossing == "frame"))
        assert len(got[e]) > 2000


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("defer", [False, True])
def test_events_without_room_come_all_the_same(device, defer):
    """Every call but the first outgrows the list, with others in flight behind it."""
    frames = walk(np.random.default_rng(1), 1, 24, 40, 50, sigma=0.6)
    t = np.arange(1, 25, dtype=np.int64) * MS
    small, large = (Passes(device, 40, 50, defer=defer) for _ in range(2))
    small.event_list.pipeline.grow(64)
    want = expected(frames[0], t)
    for passes in (small, large):
        assert np.array_equal(passes.run(frames, t, 3)[0], want)
        assert sum(int(f[0]) for f in passes.found) == len(want)
    assert len(want) > 20_000


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    ("rows", "a_call", "envs"), [(1, 2, 1), (4, 2, 1), (40, 2, 1), (100, 2, 2), (700, 1, 2), (700, 2, 1), (700, 6, 1)]
)
def test_pixels_that_fire_together(device, rows, a_call, envs):
    """At one nanosecond, few, many or too many for a bucket, of which there are some, or more than are listed."""
    level = np.exp(np.array([0, 0.5, -0.5, 0.9, 0.1, 1.5])).astype(np.float32)
    frames = np.tile(level[None, :, None, None], (envs, 1, rows, 50))
    t = np.arange(1, 7, dtype=np.int64) * MS
    got, *others = Passes(device, rows, 50, envs).run(frames, t, a_call)
    assert all(np.array_equal(got, other) for other in others)
    want, pixels = expected(frames[0, :, :1, :1], t), 50 * rows
    assert 40 * 50 < sort_kernels.ROOM < 100 * 50 < order_kernels.CROWD < 700 * 50 and len(got) == pixels * len(want)
    assert np.array_equal(got[:, 0].reshape(-1, pixels), np.repeat(want[:, :1], pixels, 1))
    y, x = np.divmod(np.arange(pixels), 50)
    assert (got[:, 1].reshape(-1, pixels) == y).all() and (got[:, 2].reshape(-1, pixels) == x).all()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("crossing", ["linear", "frame"])
def test_where_frames_end_in_the_events_of_a_call(device, crossing):
    """Told by the call, also where the host sorted, and counted for any other time."""
    frames = walk(np.random.default_rng(3), 1, 6, 20, 30)
    crowded = np.tile(frames[:, :, :1, :1], (1, 1, 700, 50))
    t = np.arange(1, 7, dtype=np.int64) * MS
    for images in (frames, crowded):
        passes = Passes(device, *images.shape[2:], crossing=crossing)
        events = passes.submit(images, t).result()
        times = events.numpy().t
        assert events.up_to(t.tolist()) == [int((times <= stamp).sum()) for stamp in t] and len(times) > 500
        assert events.up_to([t[1] + 3, t[4]]) == [int((times <= t[1] + 3).sum()), int((times <= t[4]).sum())]
        assert events.copy().up_to(t.tolist()) == events.up_to(t.tolist())


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("defer", [False, True])
def test_buckets_grow_with_the_events(device, defer):
    """After some calls with many events there are more buckets, and the events are the same: those too that are listed
    already, and put in order by the new buckets, which may be where other numbers were."""
    frames = walk(np.random.default_rng(4), 1, 24, 40, 50, sigma=0.6)
    t = np.arange(1, 25, dtype=np.int64) * MS
    passes = Passes(device, 40, 50, defer=defer)
    order = passes.event_list.pipeline._order
    order._make(4)
    used = [wp.full(32 << k, 1 << 20, dtype=wp.int32, device=device) for k in range(8)]
    del used
    assert np.array_equal(passes.run(frames, t, 4)[0], expected(frames[0], t))
    assert order.filled[0].size > 32


@pytest.mark.parametrize("device", DEVICES)
def test_results_must_be_taken_in_time(device):
    frames = walk(np.random.default_rng(2), 1, 2 * CALLS, 5, 6)
    t = np.arange(1, 2 * CALLS + 1, dtype=np.int64) * MS
    passes = Passes(device, 5, 6, defer=True)
    waiting = [passes.submit(frames[:, k : k + 1], t[k : k + 1]) for k in range(CALLS)]
    with pytest.raises(ValueError, match="take the result"):
        passes.event_list.submit(Batch(frames, frames, t, 1, 1, 0, 0, np.zeros(1), None), 9 * MS)
    events = waiting[0].result()
    kept = events.copy()
    first = events.numpy()
    passes.submit(frames[:, CALLS : CALLS + 1], t[CALLS : CALLS + 1])
    with pytest.raises(ValueError, match="gone"):
        events.t.numpy()
    assert kept.numpy().t.tobytes() == first.t.tobytes()
    assert [len(p.result()) for p in waiting[1:]] == [
        len(expected(frames[0, : k + 1], t)) - len(expected(frames[0, :k], t)) for k in range(1, CALLS)
    ]
