# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""Kernel of the readout: a single-server queue, and counter-based Gaussian delays."""

import warp as wp

from nodes.event_sensor.kernels import Sensor, key_head, key_tail

wp.set_module_options({"enable_backward": False})

REACH = wp.constant(wp.float64(3.0))
"""Standard deviations by which the jitter is centred and at which it is cut."""
UNIT = wp.constant(wp.float64(2.0**-53))
STREAM = wp.constant(wp.uint64(0x7265_6164_6F75_74))
"""Keeps these random numbers apart from others of the same seed."""
BLOCK = wp.constant(16384)
"""Events that one thread packs."""


@wp.struct
class Queue:
    """Times in units of 2^-fraction ns after t_base. capacity 0: no limit. sigma [ns]."""

    service: wp.int64
    fraction: wp.int64
    capacity: wp.int64
    sigma: wp.float64
    seed: wp.uint64
    width: wp.int64
    height: wp.int64


@wp.func
def mix(h: wp.uint64):
    """SplitMix64's output function (Steele, Lea and Flood, OOPSLA 2014)."""
    h = h + wp.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> wp.uint64(30))) * wp.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> wp.uint64(27))) * wp.uint64(0x94D049BB133111EB)
    return h ^ (h >> wp.uint64(31))


@wp.func
def uniform(h: wp.uint64):
    """In (0, 1), from the upper 53 bits."""
    return (wp.float64(h >> wp.uint64(11)) + wp.float64(0.5)) * UNIT


@wp.func
def delay(queue: Queue, env: wp.int32, pixel: wp.int64, t: wp.int64):
    """sigma (REACH + N) [ns], N standard normal cut at +-REACH: never negative. Depends on its arguments alone."""
    h = mix(mix(mix(queue.seed + wp.uint64(env)) ^ STREAM ^ wp.uint64(pixel)) ^ wp.uint64(t))
    radius = wp.sqrt(wp.float64(-2.0) * wp.log(uniform(h)))
    normal = radius * wp.cos(wp.float64(6.283185307179586) * uniform(mix(h)))
    normal = wp.clamp(normal, -REACH, REACH)
    return wp.int64(wp.floor(queue.sigma * (REACH + normal) + wp.float64(0.5)))


@wp.kernel
def serve(
    # in
    queue: Queue,
    t_base: wp.int64,
    offsets: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8),
    # in and out
    free: wp.array(dtype=wp.int64),
    # out: stamps (-1: dropped); per environment events that waited, ns that all waited, longest wait, drops
    stamps: wp.array(dtype=wp.int64),
    statistics: wp.array2d(dtype=wp.int64),
):
    """One environment per thread. Event i leaves at D_i = max(t_i, D_{i-1} + service); `free` is D_{i-1} + service."""
    env = wp.tid()
    ready = free[env]
    up = (wp.int64(1) << queue.fraction) - wp.int64(1)
    i = offsets[env]
    end = offsets[env + 1]
    while i < end:
        arrival = (t[i] - t_base) << queue.fraction
        if queue.capacity > wp.int64(0) and ready - arrival > queue.capacity * queue.service:
            stamps[i] = wp.int64(-1)
            statistics[env, 3] = statistics[env, 3] + wp.int64(1)
        else:
            leaves = wp.max(arrival, ready)
            ready = leaves + queue.service
            # Up to the next whole ns: nothing leaves before its turn.
            stamp = t_base + ((leaves + up) >> queue.fraction)
            if leaves > arrival:
                statistics[env, 0] = statistics[env, 0] + wp.int64(1)
                statistics[env, 1] = statistics[env, 1] + stamp - t[i]
                statistics[env, 2] = wp.max(statistics[env, 2], stamp - t[i])
            if queue.sigma > wp.float64(0.0):
                channel = wp.int64(0)
                if c.shape[0] > 0:
                    channel = wp.int64(c[i])
                pixel = (channel * queue.height + wp.int64(y[i])) * queue.width + wp.int64(x[i])
                stamp += delay(queue, env, pixel * wp.int64(2) + wp.int64(p[i]), t[i])
            stamps[i] = stamp
        i += wp.int64(1)
    free[env] = ready


@wp.kernel
def pack(
    # in
    sensor: Sensor,
    t_base: wp.int64,
    env: wp.array(dtype=wp.int32),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8),
    # out: keys, and 0 where they do not ascend
    keys: wp.array(dtype=wp.int64),
    ascending: wp.array(dtype=wp.int32),
):
    """Columns to keys as in packet.KeyLayout, BLOCK of them a thread."""
    first = wp.tid() * BLOCK
    i = wp.int32(first)
    end = wp.min(first + BLOCK, t.shape[0])
    before = wp.int64(-1)
    if i > 0:
        before = keys[i - 1]
    rising = bool(True)
    while i < end:
        channel = wp.int32(0)
        if c.shape[0] > 0:
            channel = wp.int32(c[i])
        key = key_head(sensor, env[i]) | ((t[i] - t_base) << sensor.shift_t)
        key = key | key_tail(sensor, wp.int32(y[i]), wp.int32(x[i]), channel, p[i] != wp.uint8(0))
        rising = rising and key >= before
        keys[i] = key
        before = key
        i += 1
    if not rising:
        ascending[0] = 0


@wp.kernel
def tidy(
    # in
    count: wp.int32,
    # in and out
    keys: wp.array(dtype=wp.int64),
):
    """Insertion sort of keys that are in order but for those of one time; one thread."""
    i = int(1)
    while i < count:
        key = keys[i]
        j = i
        while j > 0 and keys[wp.max(j - 1, 0)] > key:
            keys[j] = keys[j - 1]
            j -= 1
        keys[j] = key
        i += 1
