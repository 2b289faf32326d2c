"""Senses the ideal sensor's pixels that have further samples between the frames, on a CPU: in C++, pixel by pixel.

What is computed is what cross_levels and emit_listed of ideal_simd.h compute, in the same arithmetic, so that a pixel
has the same events whether a sample of it comes as one of a frame or as a further one.
"""

from pathlib import Path

import warp as wp

from evis.native_code import native_code
from nodes.event_sensor.cpu.simd_kernels import CONSTANTS, IDEAL, LOGARITHM, IdealState
from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})

FURTHER = Path(__file__).with_name("further.h")
HEADERS = [LOGARITHM, IDEAL, FURTHER]
WALK = """
return walk_further(sensor, luminance, t, t_base, first, offset, value, shared, state, env, inner, keys, counters);"""
AT_ENV, AT_PIXEL = range(2)
"""Progress: the environment and the pixel to go on from; all environments: nothing is left."""


@wp.func_native(native_code(HEADERS, WALK, CONSTANTS))
def walk_further(
    sensor: Sensor, luminance: wp.array(dtype=wp.float32), t: wp.array(dtype=wp.int64), t_base: wp.int64,
    first: wp.array(dtype=wp.int32), offset: wp.array(dtype=wp.int32), value: wp.array(dtype=wp.float32),
    shared: wp.int32, state: IdealState, env: wp.int32, inner: wp.int32, keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
) -> wp.int32:  # fmt: skip
    """Takes the pixels of an environment from `inner` on that have further samples through all samples of a message.

    It returns the first that found no room for its events and is as it was, or the number of pixels.
    """
    ...


@wp.kernel(module="unique", enable_backward=False)
def sense_further(
    # in
    sensor: Sensor,
    luminance: wp.array(dtype=wp.float32),
    t: wp.array(dtype=wp.int64),
    t_base: wp.int64,
    envs: wp.int32,
    first: wp.array(dtype=wp.int32),
    offset: wp.array(dtype=wp.int32),
    value: wp.array(dtype=wp.float32),
    shared: wp.int32,
    # in and out
    state: IdealState,
    progress: wp.array(dtype=wp.int64),
    # out
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """Lists the events of pixels with further samples in the order of pixels, from `progress` on, as many as fit."""
    size = sensor.height * sensor.width * sensor.channels
    env = wp.int32(progress[AT_ENV])
    inner = wp.int32(progress[AT_PIXEL])
    while env < envs:
        inner = walk_further(
            sensor, luminance, t, t_base, first, offset, value, shared, state, env, inner, keys, counters
        )
        progress[AT_PIXEL] = wp.int64(inner)
        if inner < size:
            return
        inner = wp.int32(0)
        env += 1
        progress[AT_ENV] = wp.int64(env)
        progress[AT_PIXEL] = wp.int64(0)


@wp.func_native(native_code(HEADERS, "merge_sorted(more, n, count, keys);", CONSTANTS))
def merge_sorted(more: wp.array(dtype=wp.int64), n: wp.int64, count: wp.int64, keys: wp.array(dtype=wp.int64)):
    """Merges n sorted keys into the `count` sorted ones of a list with room for all."""
    ...


@wp.kernel(module="unique", enable_backward=False)
def merge(
    # in
    more: wp.array(dtype=wp.int64),
    n: wp.int64,
    count: wp.int64,
    # in and out
    keys: wp.array(dtype=wp.int64),
):
    """Merges the sorted keys of further events into the sorted `keys`, by one thread."""
    merge_sorted(more, n, count, keys)
