"""What is written for a CPU's vector units gives the bits of the model's functions, over random steps and at edges."""

import numpy as np
import pytest
import warp as wp

from evis import random_number_kernels
from evis.native_code import native_code
from evis.random_numbers import GOLDEN, mix, open_uniform
from nodes.event_sensor.cpu.crossings_simd_kernels import fire_on_line
from nodes.event_sensor.cpu.order_kernels import to_columns
from nodes.event_sensor.cpu.simd_kernels import (
    BLOCK,
    LOGARITHM,
    SPARE,
    IdealState,
    Listed,
    cross_levels,
    emit_listed,
    room_for_block,
)
from nodes.event_sensor.engines.engine import sensor_struct
from nodes.event_sensor.model.crossing_kernels import crossing_on_line, root_of_line, stamp_of
from nodes.event_sensor.model.key_kernels import (
    Columns,
    column_of,
    key_head,
    key_tail,
    key_time,
    row_of,
    time_of,
    unpack_to,
)
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import TOLERANCE, Sensor, has_level, light_seen
from nodes.event_sensor.model.state_kernels import Reference
from nodes.event_sensor.model.threshold_kernels import range_around, reference_level, thresholds_crossed
from nodes.event_sensor.parameters import FLOOR, resolve_sensor
from nodes.event_sensor.readout.readout_kernels import readout, to_keys

# Products and sums are rounded apart, as in the headers.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

HEIGHT, WIDTH, CHANNELS = 12, 61, 3
EDGES = np.array(
    [0.0, -0.0, np.nan, np.inf, -np.inf, -1.0, 1e-45, 1e-40, 1.1754944e-38, FLOOR, 0.5 * FLOOR, 1.0, 3.4028235e38],
    np.float32,
)


@wp.func_native(native_code([LOGARITHM], "return log_of(x);"))
def log_of(x: wp.float64) -> wp.float64: ...


@wp.func_native(readout("return mix(h);"))
def readout_mix(h: wp.uint64) -> wp.uint64: ...


@wp.kernel
def crossed_together(
    # in
    sensor: Sensor,
    span: wp.int64,
    stamped: wp.bool,
    state: IdealState,
    first: wp.int32,
    n: wp.int32,
    work: Listed,
    # out
    keys: wp.array(dtype=wp.int64),
    total: wp.array(dtype=wp.int64),
):
    """The twin: all pixels of a block together."""
    total[0] = cross_levels(sensor, span, state, 0, first, n, work)
    if total[0] + wp.int64(wp.static(SPARE)) <= wp.int64(keys.shape[0]):
        emit_listed(sensor, span, stamped, n, work, wp.uint64(keys.ptr), wp.int64(0))


@wp.kernel
def crossed_one_by_one(
    # in
    sensor: Sensor,
    span: wp.int64,
    stamped: wp.bool,
    low: wp.array(dtype=wp.float32),
    level: wp.array(dtype=Reference),
    first: wp.int32,
    before: wp.array(dtype=wp.float32),
    after: wp.array(dtype=wp.float32),
    offsets: wp.array(dtype=wp.int64),
    # out
    counts: wp.array(dtype=wp.int32),
    base: wp.array(dtype=wp.float64),
    net: wp.array(dtype=wp.int32),
    n_off: wp.array(dtype=wp.int32),
    bottom: wp.array(dtype=wp.float32),
    top: wp.array(dtype=wp.float32),
    keys: wp.array(dtype=wp.int64),
):
    """The model: counts first (no keys), then keys."""
    i = wp.tid()
    v = after[i]
    good = has_level(sensor, v)
    fresh = low[i] > 3.0e38
    l0 = log_of(light_seen(sensor, before[i]))
    l1 = wp.float64(0.0)
    if good:
        l1 = log_of(light_seen(sensor, v))
    here = level[i]
    reference = reference_level(here.base, here.net, here.n_off, sensor.threshold_on, sensor.threshold_off)
    n, signed = thresholds_crossed(l1 - reference, sensor.threshold_on, sensor.threshold_off, TOLERANCE)
    on = signed > wp.float64(0.0)
    if fresh or not good:
        n = 0
    counts[i] = n
    base[i] = here.base
    net[i] = here.net + wp.where(on, n, -n)
    n_off[i] = here.n_off + wp.where(on, 0, n)
    after_step = reference + wp.float64(n) * signed
    if good and fresh:
        base[i] = l1
        net[i] = 0
        n_off[i] = 0
        after_step = l1
    limits = range_around(sensor, after_step)
    bottom[i] = limits[0]
    top[i] = limits[1]
    inner = first + i
    c = inner % sensor.channels
    x = (inner // sensor.channels) % sensor.width
    y = inner // (sensor.channels * sensor.width)
    slope = wp.float64(span) / (l1 - l0)
    j = wp.int32(0)
    while j < n and keys.shape[0] > 0:
        ns = span
        if not stamped:
            ns = crossing_on_line(reference + wp.float64(j + 1) * signed, l0, slope, wp.float64(span))
        keys[offsets[i] + wp.int64(j)] = key_time(sensor, ns) | key_tail(sensor, y, x, c, on)
        j += 1


def sensor_of(on, off, dark):
    p = resolve_sensor("test", "ideal", {"dark_level": dark})
    p["threshold_on"], p["threshold_off"] = on, off
    return sensor_struct(p, (HEIGHT, WIDTH, CHANNELS), KeyLayout.of(HEIGHT, WIDTH, 2), 5)


def on_cpu(values, dtype):
    return wp.array(values, dtype=dtype, device="cpu", copy=False)


@pytest.mark.parametrize("stamped", [False, True])
@pytest.mark.parametrize("span", [1, 7, 1_000_000, 4_000_000_000])
@pytest.mark.parametrize(("on", "off", "dark"), [(0.2, 0.2, 0.0), (0.13, 0.31, 0.0), (0.02, 0.05, 1e-3)])
def test_an_ideal_step_of_many_pixels_is_that_of_each(on, off, dark, span, stamped):
    rng = np.random.default_rng(span)
    n = BLOCK
    sensor, first = sensor_of(on, off, dark), 77
    signal = rng.uniform(-17, 20, n)
    after = np.exp(np.clip(signal + rng.normal(0, rng.choice([0.05, 1.0, 8.0], n)), -60, 88)).astype(np.float32)
    after[rng.random(n) < 0.2] = rng.choice(EDGES)
    after[: len(EDGES)] = EDGES
    before = np.exp(signal).astype(np.float32)
    before[rng.random(n) < 0.1] = 0.0 if dark else 1e-40
    struct = Reference
    level = np.zeros(n, struct.numpy_dtype())
    level["base"] = np.log(np.maximum(before + dark, FLOOR)) + rng.uniform(-0.3, 0.3, n)
    level["net"], level["n_off"] = rng.integers(-40, 40, n), rng.integers(0, 9, n)
    low = np.where(rng.random(n) < 0.1, np.inf, 0.5).astype(np.float32)
    low[len(EDGES)] = np.inf
    state = IdealState()
    state.last, state.low = on_cpu(before, wp.float32), on_cpu(low, wp.float32)
    state.high, state.level = on_cpu(low.copy(), wp.float32), on_cpu(level, Reference)
    work = room_for_block()
    work.place.numpy()[:] = np.arange(n)
    work.before.numpy()[:], work.after.numpy()[:] = before, after

    counts, net, n_off = (np.zeros(n, np.int32) for _ in range(3))
    base, bottom, top = np.zeros(n), np.zeros(n, np.float32), np.zeros(n, np.float32)
    outputs = [on_cpu(a, t) for a, t in ((counts, wp.int32), (base, wp.float64), (net, wp.int32), (n_off, wp.int32),
                                         (bottom, wp.float32), (top, wp.float32))]  # fmt: skip

    def one_by_one(offsets, keys):
        inputs = [
            sensor,
            span,
            stamped,
            state.low,
            state.level,
            first,
            work.before,
            work.after,
            on_cpu(offsets, wp.int64),
        ]
        wp.launch(crossed_one_by_one, n, inputs, [*outputs, on_cpu(keys, wp.int64)], device="cpu")

    one_by_one(np.zeros(n, np.int64), np.zeros(0, np.int64))
    offsets = np.append(0, np.cumsum(counts, dtype=np.int64))
    wanted, got, total = np.zeros(offsets[-1], np.int64), np.zeros(offsets[-1] + SPARE, np.int64), np.zeros(1, np.int64)
    one_by_one(offsets[:-1].copy(), wanted)
    wp.launch(
        crossed_together, 1, [sensor, span, stamped, state, first, n, work],
        [on_cpu(got, wp.int64), on_cpu(total, wp.int64)], device="cpu",
    )  # fmt: skip
    assert total[0] == offsets[-1] > n and counts.max() > 8
    assert np.array_equal(work.count.numpy(), counts)
    assert np.array_equal(work.base.numpy().view(np.int64), base.view(np.int64))
    assert np.array_equal(work.net.numpy(), net) and np.array_equal(work.n_off.numpy(), n_off)
    assert np.array_equal(got[: total[0]], wanted)
    # The range is no part of any event: both stay within the thresholds, by different exponentials. (That of float32
    # overflows for the largest samples.)
    good = (after >= 0) & (after <= 1e38) & (after.astype(np.float64) + dark > 0)
    for mine, model in ((work.low.numpy(), bottom), (work.high.numpy(), top)):
        mine, model = (np.maximum(a[good].astype(np.float64) + dark, FLOOR) for a in (mine, model))
        assert np.allclose(mine, model, rtol=3e-5, atol=0)


@wp.kernel
def on_a_line(
    # in
    sensor: Sensor,
    s: wp.array(dtype=wp.vec4d),
    reference: wp.array(dtype=wp.float64),
    threshold: wp.array(dtype=wp.float64),
    count: wp.array(dtype=wp.int32),
    ends: wp.array(dtype=wp.vec2d),
    together: wp.bool,
    # out
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """Events of one piece of a step for each i, from stamp 1000 on, 10^6 ns long."""
    i = wp.tid()
    start = wp.int64(1000)
    until = start + wp.int64(1000000)
    h = wp.float64(1.0e6)
    place = key_tail(sensor, 3, i % sensor.width, 0, True)
    u = ends[i][0]
    piece = ends[i][1]
    if together:
        fire_on_line(
            sensor, s[i], reference[i], threshold[i], count[i], u, piece, start, until, h, wp.int64(0), place, start, 0,
            False, keys, counters,
        )  # fmt: skip
    else:
        j = wp.int32(0)
        time = start
        while j < count[i]:
            root = root_of_line(s[i], reference[i] + wp.float64(j + 1) * threshold[i], u, piece)
            time = wp.clamp(stamp_of(root, h, start), time, until)
            keys[counters[0]] = key_time(sensor, time) | place
            counters[0] = counters[0] + wp.int64(1)
            j += 1


def test_crossings_of_a_line_together_are_those_one_by_one():
    rng = np.random.default_rng(8)
    n = 3000
    sensor = sensor_of(0.2, 0.2, 0.0)
    s = np.zeros((n, 4))
    s[:, 0], s[:, 1] = rng.normal(0, 3, n), rng.normal(0, 3, n) * 10.0 ** rng.integers(-18, 3, n)
    s[::50, 1] = 0.0
    threshold = rng.choice([-1, 1], n) * rng.uniform(0.001, 0.4, n)
    reference, count = s[:, 0] + rng.normal(0, 0.1, n), rng.integers(0, 40, n).astype(np.int32)
    ends = np.sort(rng.uniform(0, 1, (n, 2)), axis=1)
    ends[::3] = 0.0, 1.0
    room = int(count.sum())
    sensor.capacity = room
    found = []
    for together in (False, True):
        keys, counters = np.zeros(room + SPARE, np.int64), np.zeros(6, np.int64)
        inputs = [sensor, on_cpu(s, wp.vec4d), on_cpu(reference, wp.float64), on_cpu(threshold, wp.float64),
                  on_cpu(count, wp.int32), on_cpu(ends, wp.vec2d), together]  # fmt: skip
        wp.launch(on_a_line, n, inputs, [on_cpu(keys, wp.int64), on_cpu(counters, wp.int64)], device="cpu")
        assert counters[0] == room
        found.append(keys[:room])
    assert np.array_equal(*found)


@wp.kernel
def keys_both_ways(
    # in
    sensor: Sensor,
    t_base: wp.int64,
    env: wp.array(dtype=wp.int32),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8),
    # out
    together: wp.array(dtype=wp.int64),
    alone: wp.array(dtype=wp.int64),
    columns: Columns,
    unpacked: Columns,
    fields: wp.array2d(dtype=wp.int64),
):
    """By one thread: pack and unpack, all together and one by one."""
    to_keys(sensor, t_base, env, t, x, y, p, c, together)
    to_columns(sensor, t_base, together, columns.t, columns.x, columns.y, columns.p)
    for i in range(t.shape[0]):
        tail = key_tail(sensor, wp.int32(y[i]), wp.int32(x[i]), wp.int32(c[i]), p[i] != wp.uint8(0))
        alone[i] = key_head(sensor, env[i]) | key_time(sensor, t[i] - t_base) | tail
        unpack_to(sensor, t_base, alone[i], i, unpacked)
        fields[i, 0] = time_of(sensor, alone[i])
        fields[i, 1] = row_of(sensor, alone[i])
        fields[i, 2] = column_of(sensor, alone[i])


def test_keys_packed_and_unpacked_together_are_those_one_by_one():
    rng = np.random.default_rng(1)
    n, t_base = 5001, 10**15
    sensor = sensor_of(0.2, 0.2, 0.0)
    types = {"t": wp.int64, "x": wp.uint16, "y": wp.uint16, "p": wp.uint8, "c": wp.uint8}
    given = {
        "t": t_base + rng.integers(0, 1 << 40, n), "x": rng.integers(0, WIDTH, n).astype(np.uint16),
        "y": rng.integers(0, HEIGHT, n).astype(np.uint16), "p": rng.integers(0, 2, n).astype(np.uint8),
        "c": rng.integers(0, 3, n).astype(np.uint8),
    }  # fmt: skip
    env = rng.integers(0, 2, n).astype(np.int32)
    together, alone, fields = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3), np.int64)
    columns, unpacked = Columns(), Columns()
    for name, dtype in types.items():
        for made in (columns, unpacked):
            setattr(made, name, wp.zeros(n, dtype=dtype, device="cpu"))
    inputs = [sensor, t_base, on_cpu(env, wp.int32), *(on_cpu(given[name], dtype) for name, dtype in types.items())]
    outputs = [on_cpu(together, wp.int64), on_cpu(alone, wp.int64), columns, unpacked, on_cpu(fields, wp.int64)]
    wp.launch(keys_both_ways, 1, inputs, outputs, device="cpu")
    assert np.array_equal(together, alone)
    for name in types:
        assert np.array_equal(getattr(unpacked, name).numpy(), given[name]), name
        assert name == "c" or np.array_equal(getattr(columns, name).numpy(), given[name]), name
    assert np.array_equal(fields, np.stack((given["t"] - t_base, given["y"], given["x"]), 1))


@wp.kernel
def random_both_ways(
    # in
    bits: wp.array(dtype=wp.uint64),
    # out
    model: wp.array(dtype=wp.uint64),
    drawn: wp.array(dtype=wp.uint64),
    together: wp.array(dtype=wp.uint64),
    uniform: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    model[i] = random_number_kernels.mix(bits[i])
    drawn[i] = random_number_kernels.draw(bits[i], wp.int64(0))
    together[i] = readout_mix(bits[i])
    uniform[i] = random_number_kernels.uniform(bits[i])


def test_random_numbers_are_the_same_in_kernels_in_headers_and_in_numpy():
    bits = np.random.default_rng(0).integers(0, 2**64, 10_000, np.uint64)
    bits[:3] = 0, 1, 2**64 - 1
    model, drawn, together = (np.zeros_like(bits) for _ in range(3))
    uniform = np.zeros(len(bits))
    outputs = [*(on_cpu(a, wp.uint64) for a in (model, drawn, together)), on_cpu(uniform, wp.float64)]
    wp.launch(random_both_ways, len(bits), [on_cpu(bits, wp.uint64)], outputs, device="cpu")
    assert np.array_equal(model, mix(bits)) and np.array_equal(drawn, mix(bits + GOLDEN))
    assert np.array_equal(together, drawn)
    # Those of numpy lie half a step higher than a kernel's, where a logarithm can always be taken.
    assert np.array_equal(uniform, (bits >> np.uint64(11)) * 2.0**-53)
    assert np.abs(uniform - open_uniform(bits)).max() <= 2.0**-53
