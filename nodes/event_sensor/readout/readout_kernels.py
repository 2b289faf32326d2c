"""Computes the readout, on a CPU and in C++: a single-server queue, counter-based Gaussian delays, keys in order."""

from pathlib import Path

import numpy as np
import warp as wp

from evis.native_code import native_code
from nodes.event_sensor.cpu.simd_kernels import LOGARITHM
from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})

REACH = wp.constant(wp.float64(3.0))
"""Standard deviations by which the jitter is centred and at which it is cut."""
STREAM = 0x7265_6164_6F75_74
"""Keeps these random numbers apart from others of the same seed."""
TURNED_AWAY = -(2**63)
"""Stamp of an event that found the queue full; times below 0 are stamps as any other."""
READOUT = Path(__file__).with_name("readout.h")


def readout(call: str) -> str:
    """Returns the code of a function of readout.h, with this call of it."""
    constants = {"REACH": float(REACH), "STREAM": np.uint64(STREAM), "TURNED_AWAY": np.uint64(TURNED_AWAY % 2**64)}
    return native_code([LOGARITHM, READOUT], call, constants)


@wp.struct
class Queue:
    """Holds the readout's parameters; times are in units of 2^-fraction ns after t_base.

    capacity 0: no limit. sigma [ns].
    """

    service: wp.int64
    fraction: wp.int64
    capacity: wp.int64
    sigma: wp.float64
    width: wp.int64
    height: wp.int64


@wp.func_native(readout("serve(queue, env, begin, end, t_base, t, free, stamps, statistics);"))
def served(
    queue: Queue, env: wp.int32, begin: wp.int64, end: wp.int64, t_base: wp.int64, t: wp.array(dtype=wp.int64),
    free: wp.array(dtype=wp.int64), stamps: wp.array(dtype=wp.int64), statistics: wp.array2d(dtype=wp.int64),
):  # fmt: skip
    """Computes when events leave: event i at D_i = max(t_i, D_{i-1} + service); `free` is D_{i-1} + service."""
    ...


@wp.func_native(readout("delay(queue, seed, origin, begin, end, t, x, y, p, c, stamps);"))
def jittered(
    queue: Queue, seed: wp.uint64, origin: wp.int64, begin: wp.int64, end: wp.int64, t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16), y: wp.array(dtype=wp.uint16), p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8), stamps: wp.array(dtype=wp.int64),
):  # fmt: skip
    """Adds sigma (REACH + N) [ns], N standard normal cut at +-REACH: never negative, of the event's fields alone.

    seed: of the environment in its episode. origin: when that began [ns].
    """
    ...


@wp.kernel(module="unique", enable_backward=False)
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
    origins: wp.array(dtype=wp.int64),
    seeds: wp.array(dtype=wp.uint64),
    # in and out: stamps are those of the events at first, TURNED_AWAY for dropped ones after
    free: wp.array(dtype=wp.int64),
    stamps: wp.array(dtype=wp.int64),
    # out: per environment events that waited, ns that all waited, longest wait, drops
    statistics: wp.array2d(dtype=wp.int64),
):
    """Computes when the events of an environment leave; one environment per thread."""
    env = wp.tid()
    if queue.service > wp.int64(0):
        served(queue, env, offsets[env], offsets[env + 1], t_base, t, free, stamps, statistics)
    if queue.sigma > wp.float64(0.0):
        jittered(queue, seeds[env], origins[env], offsets[env], offsets[env + 1], t, x, y, p, c, stamps)


@wp.func_native(readout("return to_keys(sensor, t_base, env, t, x, y, p, c, keys);"))
def to_keys(
    sensor: Sensor, t_base: wp.int64, env: wp.array(dtype=wp.int32), t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16), y: wp.array(dtype=wp.uint16), p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8), keys: wp.array(dtype=wp.int64),
) -> wp.bool:  # fmt: skip
    """Packs columns into keys as model.keys.KeyLayout says; returns whether they ascend."""
    ...


@wp.kernel(module="unique", enable_backward=False)
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
    """Packs columns into keys, by one thread."""
    ascending[0] = wp.where(to_keys(sensor, t_base, env, t, x, y, p, c, keys), 1, 0)


@wp.func_native(readout("insertion_sort(count, keys);"))
def insertion_sort(count: wp.int32, keys: wp.array(dtype=wp.int64)):
    """Sorts keys that are in order but for those of one time."""
    ...


@wp.kernel(module="unique", enable_backward=False)
def tidy(
    # in
    count: wp.int32,
    # in and out
    keys: wp.array(dtype=wp.int64),
):
    """Sorts keys that are in order but for those of one time, by one thread."""
    insertion_sort(count, keys)
