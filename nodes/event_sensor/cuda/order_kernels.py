# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Events in order without the host: buckets of time, where each begins, and the order inside each.

A bucket takes the events of one environment in one part of the call's time, or, where all events of a frame have its
stamp, of one frame in one part of the image. That is a coarse order of the keys, so what is left is small sorts in
each bucket, in which an event's place is the number of events before it: no passes, and no order of arrival that could
show. Where one bucket runs over (many pixels that fire at one nanosecond) the host sorts the list instead.
"""

import warp as wp

from evis.gpu.append_kernels import take_place_at
from nodes.event_sensor.cuda.call_kernels import (
    BLOCKED,
    COUNTS,
    CROWDED,
    FULL_FROM,
    NOWHERE,
    OFFSETS,
    OUTGROWN,
    SKIPPED,
    SPAN,
    STAMPS,
    STATUS,
    T_BASE,
)
from nodes.event_sensor.model.key_kernels import Columns, column_of, row_of, time_of, unpack_to
from nodes.event_sensor.model.sensor_kernels import EVENTS, Sensor

wp.set_module_options({"enable_backward": False})

BUCKET = 2048
"""Events for which a bucket has room."""
FEW = 64
"""Events of a bucket up to which each is compared with all the others."""

SORT = """
#if defined(__CUDA_ARCH__)
    __shared__ wp::int64 keys[ROOM];
    const int lane = threadIdx.x;
    const int lanes = blockDim.x;
#else
    wp::int64* keys = bucket.data + first;
    const int lane = 0;
    const int lanes = 1;
#endif
    wp::int64* home = bucket.data + first;
    int size = 1;
    while (size < count) size *= 2;
    for (int i = lane; i < size; i += lanes) keys[i] = i < count ? home[i] : wp::int64(0x7FFFFFFFFFFFFFFFll);
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
    for (int run = 2; run <= size; run *= 2)
        for (int apart = run / 2; apart > 0; apart /= 2) {
            for (int pair = lane; pair < size / 2; pair += lanes) {
                const int a = 2 * pair - (pair & (apart - 1));
                const int b = a + apart;
                const wp::int64 one = keys[a];
                const wp::int64 other = keys[b];
                if ((one > other) == ((a & run) == 0)) {
                    keys[a] = other;
                    keys[b] = one;
                }
            }
#if defined(__CUDA_ARCH__)
            // Pairs at most 32 apart stay with the 64 keys of their warp.
            if (apart > 32 || (apart == 1 && run >= 64)) __syncthreads();
            else __syncwarp();
#endif
        }
#if defined(__CUDA_ARCH__)
    for (int i = lane; i < count; i += lanes) home[i] = keys[i];
#endif
""".replace("ROOM", str(BUCKET))


@wp.func_native(SORT)
def sort_bucket(bucket: wp.array(dtype=wp.int64), first: wp.int32, count: wp.int32):
    """Sorts (bitonic sort, Batcher 1968) the `count` keys from `first` on, by all threads of a block.

    Thread i of n then finds the keys i, i + n, ... in their places; a CPU has room for a power of two of them.
    """
    ...


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
        call, frames: as in pipeline.Source.
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
    # out
    filled: wp.array(dtype=wp.int32),
    buckets: wp.array(dtype=wp.int64),
):
    """Puts events into buckets; a thread takes every `threads`-th.

    Args:
        sensor, call, frames: as in pipeline.Source.
        stamped: most times are those of frames.
        of_env: buckets of an environment.
        threads: how many there are.
        keys, counters: the list of events, and how many there are.
        filled: events in each bucket, those too that found no room.
        buckets: keys, int64 [E of_env BUCKET].
    """
    if counters[BLOCKED] != wp.int64(0) or counters[EVENTS] > sensor.capacity:
        return
    count = wp.int32(counters[EVENTS])
    i = wp.tid()
    while i < count:
        key = keys[i]
        t = time_of(sensor, key)
        if stamped:
            pixel = row_of(sensor, key) * wp.int64(sensor.width) + column_of(sensor, key)
            place = place_at_stamp(call, frames, t, pixel, wp.int64(sensor.width * sensor.height), of_env)
        else:
            place = place_in_time(call, t, of_env)
        b = wp.int32(key >> sensor.shift_env) * of_env + place
        slot = take_place_at(filled, b)
        if slot < wp.static(BUCKET):
            buckets[b * wp.static(BUCKET) + slot] = key
        i += threads


@wp.kernel
def in_order(
    # in
    sensor: Sensor,
    call: wp.array(dtype=wp.int64),
    of_env: wp.int32,
    filled: wp.array(dtype=wp.int32),
    buckets: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    # out
    following: wp.array(dtype=wp.int64),
    head: wp.array(dtype=wp.int64),
    columns: Columns,
):
    """Puts the events of each bucket in order; a block is a bucket.

    Equal keys are equal events, whose order does not matter. The last block writes what the host wants to know, and the
    counters that a later call begins with.

    Args:
        sensor, call: as in pipeline.Source.
        of_env: buckets of an environment.
        filled, buckets: as of to_buckets.
        counters: of this call, int64 [COUNTS].
        following: of a later call, made ready.
        head: what the host wants to know, int64, see call_kernels.
        columns: where the events go.
    """
    b, lane = wp.tid()
    length = filled.shape[0]
    count = filled[b]
    if count == 0 and b % of_env != 0 and b != length - 1:
        return
    before = int(0)
    j = lane
    while j < b:
        before += filled[j]
        j += wp.block_dim()
    start = wp.tile_sum(wp.tile(before))[0]
    blocked = counters[BLOCKED] != wp.int64(0)
    outgrown = counters[EVENTS] > sensor.capacity
    if lane == 0:
        if b % of_env == 0:
            head[OFFSETS + b // of_env] = wp.int64(start)
        if b == length - 1:
            head[OFFSETS + length // of_env] = wp.int64(start + count)
            for i in range(wp.static(COUNTS)):
                head[i] = counters[i]
                following[i] = wp.int64(0)
            following[FULL_FROM] = wp.int64(wp.static(NOWHERE))
            if blocked:
                head[STATUS] = wp.int64(wp.static(SKIPPED))
            elif outgrown:
                head[STATUS] = wp.int64(wp.static(OUTGROWN))
        if count > wp.static(BUCKET):
            head[STATUS] = wp.int64(wp.static(CROWDED))
    if blocked or outgrown or count > wp.static(BUCKET):
        return
    first = b * wp.static(BUCKET)
    few = count <= wp.static(FEW)
    if not few:
        sort_bucket(buckets, first, count)
    i = lane
    while i < count:
        key = buckets[first + i]
        place = i
        if few:
            place = int(0)
            j = int(0)
            while j < count:
                other = buckets[first + j]
                place += wp.where(other < key or (other == key and j < i), 1, 0)
                j += 1
        unpack_to(sensor, call[T_BASE], key, start + place, columns)
        i += wp.block_dim()


@wp.kernel
def unpack_all(
    # in
    sensor: Sensor,
    t_base: wp.int64,
    keys: wp.array(dtype=wp.int64),
    # out
    columns: Columns,
):
    """Writes sorted keys to columns; a thread is an event."""
    i = wp.tid()
    unpack_to(sensor, t_base, keys[i], i, columns)
