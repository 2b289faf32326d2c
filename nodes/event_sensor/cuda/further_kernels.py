# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Reads the further samples of a pixel on a GPU, in the order of time, by the addresses that a call holds."""

import warp as wp

from nodes.event_sensor.cuda.call_kernels import FIRST, FOUND, OFFSET, SHARED, STAMPS, T_BASE, VALUE
from nodes.event_sensor.input.further_kernels import FINE

wp.set_module_options({"enable_backward": False})


@wp.func
def further_entries(call: wp.array(dtype=wp.int64), index: wp.int32):
    """Returns where the further samples of a pixel and channel begin and end."""
    found = wp.vec2i(0, 0)
    there = call[FIRST] != wp.int64(0)
    if there and call[FOUND] != wp.int64(0):
        wrong = wp.array(ptr=wp.uint64(call[FOUND]), shape=(1,), dtype=wp.int64)
        there = wrong[0] == wp.int64(wp.static(FINE))
    if there:
        first = wp.array(ptr=wp.uint64(call[FIRST]), shape=(1,), dtype=wp.int32)
        one = index // wp.int32(call[SHARED])
        found = wp.vec2i(first[one], first[one + 1])
    return found


@wp.func
def offset_at(call: wp.array(dtype=wp.int64), entry: wp.int32):
    """Returns when a further sample is [ns after the call's start]."""
    offset = wp.array(ptr=wp.uint64(call[OFFSET]), shape=(1,), dtype=wp.int32)
    return wp.int64(offset[entry])


@wp.func
def value_at(call: wp.array(dtype=wp.int64), entry: wp.int32, index: wp.int32):
    """Returns a further sample of a pixel and channel."""
    value = wp.array(ptr=wp.uint64(call[VALUE]), shape=(1,), dtype=wp.float32)
    shared = wp.int32(call[SHARED])
    return value[wp.int64(entry) * wp.int64(shared) + wp.int64(index % shared)]


@wp.func
def further_is_next(call: wp.array(dtype=wp.int64), entry: wp.int32, end: wp.int32, stamp: wp.int64):
    """Tells whether further sample `entry`, of those before `end`, comes before a frame's stamp [ns]."""
    found = bool(False)
    if entry < end:
        found = call[T_BASE] + offset_at(call, entry) < stamp
    return found


@wp.func
def sample_before(call: wp.array(dtype=wp.int64), entries: wp.vec2i, first: wp.int32):
    """Finds where a pixel goes on that has dealt with `first` samples: next frame, next further sample, and the stamp
    [ns] of the sample before.

    entries: of further_entries.
    """
    entry = int(entries[0])
    start = call[T_BASE]
    k = int(0)
    if entry == entries[1]:
        k = first
        if k > 0:
            start = call[STAMPS + k - 1]
    number = int(k)
    while number < first:
        start = call[STAMPS + k]
        if further_is_next(call, entry, entries[1], start):
            start = call[T_BASE] + offset_at(call, entry)
            entry += 1
        else:
            k += 1
        number += 1
    return k, entry, start
