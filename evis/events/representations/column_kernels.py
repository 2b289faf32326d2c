"""Reads the columns of events in Warp kernels: one integer type for all, the environment of an event, spans of time."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def environment_of(i: wp.int64, offsets: wp.array(dtype=wp.int64)):
    """Finds the environment of event i: the last whose offset is not above it."""
    low = wp.int32(0)
    high = offsets.shape[0] - 2
    while low < high:
        middle = (low + high + 1) / 2
        if offsets[middle] <= i:
            low = middle
        else:
            high = middle - 1
    return low


@wp.kernel
def widen_kernel(
    # in
    values: wp.array(dtype=Any),
    # out
    wide: wp.array(dtype=wp.int32),
):
    """Copies whole numbers to int32; what does not fit becomes -1, which lies in no array."""
    i = wp.tid()
    value = wp.int64(values[i])
    if value < wp.int64(0) or value > wp.int64(2147483647):
        value = wp.int64(-1)
    wide[i] = wp.int32(value)


WIDENED = (wp.int8, wp.int16, wp.int32, wp.int64, wp.uint8, wp.uint16, wp.uint32, wp.uint64, wp.bool)
for _type in WIDENED:
    wp.overload(widen_kernel, {"values": wp.array(dtype=_type)})


@wp.kernel
def span_kernel(
    # in
    t: wp.array(dtype=wp.int64),
    offsets: wp.array(dtype=wp.int64),
    # out
    span: wp.array2d(dtype=wp.int64),
):
    """Widens the span [first, last] of each environment by the time of one event per thread."""
    i = wp.tid()
    env = environment_of(wp.int64(i), offsets)
    wp.atomic_min(span, env, 0, t[i])
    wp.atomic_max(span, env, 1, t[i])
