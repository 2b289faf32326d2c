# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Puts events in order without the host: it counts how many each bucket of time takes, finds where each begins, and
orders inside each.

A bucket takes the events of one environment in one part of the call's time, or, where all events of a frame have its
stamp, of one frame in one part of the image. That is a coarse order of the keys. Events are counted first, so that each
bucket has the room it needs, and a block then sorts it. Where one bucket is crowded (many pixels that fire at one
nanosecond) the host has it sorted by a radix sort of the whole device.
"""

import warp as wp

from evis.gpu.append_kernels import take_place_at
from nodes.event_sensor.cuda.call_kernels import (
    BLOCKED,
    COUNTS,
    CROWDED,
    CROWDS,
    FULL_FROM,
    MOST_CROWDS,
    NOT_FULL,
    OFFSETS,
    OUTGROWN,
    SKIPPED,
    SPAN,
    STAMPS,
    STATUS,
    T_BASE,
)
from nodes.event_sensor.cuda.sort_kernels import MOST, sort_bucket
from nodes.event_sensor.model.key_kernels import Columns, column_of, row_of, time_of, unpack_to
from nodes.event_sensor.model.sensor_kernels import EVENTS, Sensor

wp.set_module_options({"enable_backward": False})

CROWD = MOST
"""Events of a bucket above which the host sorts."""
FEW = 64
"""Events of a bucket up to which each is compared with all the others."""


@wp.func
def place_in_time(call: wp.array(dtype=wp.int64), t: wp.int64, of_env: wp.int32):
    """Returns in which of the `of_env` equal parts of a call's time t lies. t: from the call's start [ns]."""
    place = wp.float64(t) * (wp.float64(of_env) / wp.float64(call[SPAN] + wp.int64(1)))
    return wp.min(wp.int32(place), of_env - 1)


@wp.func
def place_at_stamp(
    call: wp.array(dtype=wp.int64), frames: wp.int32, t: wp.int64, pixel: wp.int64, pixels: wp.int64, of_env: wp.int32
):
    """Returns the bucket of an event where most have a frame's stamp: half of a frame's are for these, by their pixel.

    Args:
        call, frames: as in source.Source.
        t: time of the event from the call's start [ns].
        pixel, pixels: which one it is, and how many there are.
        of_env: buckets of an environment.
    """
    base = call[T_BASE]
    low = int(0)
    high = frames - 1
    while low < high:
        middle = (low + high) // 2
        if call[STAMPS + middle] - base < t:
            low = middle + 1
        else:
            high = middle
    k = low
    stamp = call[STAMPS + k] - base
    before = wp.int64(0)
    if k > 0:
        before = call[STAMPS + k - 1] - base
    first = wp.int32(wp.int64(k) * wp.int64(of_env) / wp.int64(frames))
    end = wp.int32(wp.int64(k + 1) * wp.int64(of_env) / wp.int64(frames))
    half = (end - first) // 2
    place = first
    if t < stamp:
        place += wp.int32(wp.float64(t - before) / wp.float64(stamp - before) * wp.float64(half))
    elif end > first:
        place += half + wp.int32(pixel * wp.int64(end - first - half) / pixels)
    return place


@wp.func
def bucket_of(
    sensor: Sensor, call: wp.array(dtype=wp.int64), frames: wp.int32, stamped: wp.bool, of_env: wp.int32, key: wp.int64
):
    """Returns the bucket of an event; arguments as of count_events."""
    t = time_of(sensor, key)
    place = int(0)
    if stamped:
        pixel = row_of(sensor, key) * wp.int64(sensor.width) + column_of(sensor, key)
        place = place_at_stamp(call, frames, t, pixel, wp.int64(sensor.width * sensor.height), of_env)
    else:
        place = place_in_time(call, t, of_env)
    return wp.int32(key >> sensor.shift_env) * of_env + place


@wp.func
def listed(sensor: Sensor, counters: wp.array(dtype=wp.int64)):
    """Returns how many events there are to be put in order: none of a call that has to be mended first."""
    count = wp.int32(0)
    if counters[BLOCKED] == wp.int64(0) and counters[EVENTS] <= sensor.capacity:
        count = wp.int32(counters[EVENTS])
    return count


@wp.kernel
def count_events(
    # in
    sensor: Sensor,
    call: wp.array(dtype=wp.int64),
    frames: wp.int32,
    stamped: wp.bool,
    of_env: wp.int32,
    threads: wp.int32,
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    # out
    filled: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
):
    """Counts the events of each bucket; a thread takes every `threads`-th.

    Args:
        sensor, call, frames: as in source.Source.
        stamped: most times are those of frames.
        of_env: buckets of an environment.
        threads: how many there are.
        keys, counters: the list of events, and how many there are.
        filled: events in each bucket.
        slots: number of each event in its bucket, in no order that matters.
    """
    count = listed(sensor, counters)
    i = wp.tid()
    while i < count:
        slots[i] = take_place_at(filled, bucket_of(sensor, call, frames, stamped, of_env, keys[i]))
        i += threads


@wp.kernel
def place_buckets(
    # in
    sensor: Sensor,
    of_env: wp.int32,
    filled: wp.array(dtype=wp.int32),
    counters: wp.array(dtype=wp.int64),
    # out
    first: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int64),
    head: wp.array(dtype=wp.int64),
):
    """Finds where each bucket begins, by one block; writes what the host wants to know, and a later call's counters.

    Args:
        sensor: as in source.Source.
        of_env: buckets of an environment.
        filled: events in each bucket.
        counters: of this call, int64 [COUNTS].
        first: number of the first event of each bucket, and behind the last that of all events.
        following: counters of a later call, made ready.
        head: what the host wants to know, int64, see call_kernels.
    """
    _, lane = wp.tid()
    length = filled.shape[0]
    each = (length + wp.block_dim() - 1) // wp.block_dim()
    begin = wp.min(lane * each, length)
    end = wp.min(begin + each, length)
    total = int(0)
    b = begin
    while b < end:
        total += filled[b]
        b += 1
    place = wp.untile(wp.tile_scan_exclusive(wp.tile(total)))
    b = begin
    while b < end:
        count = filled[b]
        first[b] = place
        if b % of_env == 0:
            head[OFFSETS + b // of_env] = wp.int64(place)
        if count > wp.static(CROWD):
            head[STATUS] = wp.int64(wp.static(CROWDED))
            crowd = wp.int32(wp.atomic_add(head, CROWDS, wp.int64(1)))
            if crowd < wp.static(MOST_CROWDS):
                head[CROWDS + 1 + 2 * crowd] = wp.int64(place)
                head[CROWDS + 2 + 2 * crowd] = wp.int64(count)
        place += count
        b += 1
    if end == length and begin < end:
        first[length] = place
        head[OFFSETS + length // of_env] = wp.int64(place)
        for i in range(wp.static(COUNTS)):
            head[i] = counters[i]
            following[i] = wp.int64(0)
        following[FULL_FROM] = wp.int64(wp.static(NOT_FULL))
        if counters[BLOCKED] != wp.int64(0):
            head[STATUS] = wp.int64(wp.static(SKIPPED))
        elif counters[EVENTS] > sensor.capacity:
            head[STATUS] = wp.int64(wp.static(OUTGROWN))


@wp.kernel
def to_buckets(
    # in
    sensor: Sensor,
    call: wp.array(dtype=wp.int64),
    frames: wp.int32,
    stamped: wp.bool,
    of_env: wp.int32,
    threads: wp.int32,
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    slots: wp.array(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    # out
    buckets: wp.array(dtype=wp.int64),
    aside: wp.array(dtype=wp.int64),
):
    """Puts events into buckets, int64 [capacity]; arguments as of count_events and place_buckets.

    aside: int64 [capacity], takes those of crowded buckets: where the times of this call will be.
    """
    count = listed(sensor, counters)
    i = wp.tid()
    while i < count:
        key = keys[i]
        b = bucket_of(sensor, call, frames, stamped, of_env, key)
        place = first[b] + slots[i]
        if first[b + 1] - first[b] > wp.static(CROWD):
            aside[place] = key
        else:
            buckets[place] = key
        i += threads


@wp.kernel
def in_order(
    # in
    sensor: Sensor,
    call: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    first: wp.array(dtype=wp.int32),
    buckets: wp.array(dtype=wp.int64),
    # out
    columns: Columns,
):
    """Puts the events of each bucket that is not crowded in order; a block is a bucket.

    Equal keys are equal events, whose order does not matter. Arguments as of count_events, place_buckets and
    to_buckets; columns: where the events go.
    """
    b, lane = wp.tid()
    start = first[b]
    count = first[b + 1] - start
    if count == 0 or count > wp.static(CROWD) or listed(sensor, counters) == 0:
        return
    few = count <= wp.static(FEW)
    if not few:
        sort_bucket(buckets, columns.t, start, count)
    i = lane
    while i < count:
        key = buckets[start + i]
        place = i
        if few:
            place = int(0)
            j = int(0)
            while j < count:
                other = buckets[start + j]
                place += wp.where(other < key or (other == key and j < i), 1, 0)
                j += 1
        unpack_to(sensor, call[T_BASE], key, start + place, columns)
        i += wp.block_dim()


@wp.kernel
def find_ends(
    # in
    sensor: Sensor,
    call: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    # out
    ends: wp.array(dtype=wp.int64),
):
    """Counts, of the ascending times t of one environment, those up to the stamp of each frame."""
    k = wp.tid()
    low = int(0)
    high = int(listed(sensor, counters))
    while low < high:
        middle = (low + high) // 2
        if t[middle] <= call[STAMPS + k]:
            low = middle + 1
        else:
            high = middle
    ends[k] = wp.int64(low)


@wp.kernel
def unpack_sorted(
    # in
    sensor: Sensor,
    t_base: wp.int64,
    keys: wp.array(dtype=wp.int64),
    first: wp.int32,
    # out
    columns: Columns,
):
    """Writes sorted keys to columns from place `first` on; a thread is an event."""
    i = wp.tid()
    unpack_to(sensor, t_base, keys[i], first + i, columns)
