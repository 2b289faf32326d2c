# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Events in order without the host: how many each bucket of time takes, where each begins, and the order inside each.

A bucket takes the events of one environment in one part of the call's time, or, where all events of a frame have its
stamp, of one frame in one part of the image. That is a coarse order of the keys. Events are counted first, so that each
bucket has the room it needs, and a block then sorts it. Where one bucket is crowded (many pixels that fire at one
nanosecond) the host sorts the list instead.
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

CROWD = 1 << 15
"""Events of a bucket above which the host sorts."""
ROOM = 1 << 12
"""Events of a bucket up to which a block sorts in the memory of its own."""
FEW = 64
"""Events of a bucket up to which each is compared with all the others."""

BLOCK = 256
"""Threads of a block that sorts a bucket."""
BINS = 2 * BLOCK
"""Parts that a block divides a bucket into."""
MOST_OF_BIN = 64
"""Events of one of them above which all are sorted by comparing pairs."""

SORT = """
#if defined(__CUDA_ARCH__)
    __shared__ wp::int64 near[ROOM];
    const int lane = threadIdx.x;
    const int lanes = blockDim.x;
#else
    const int lane = 0;
    const int lanes = 1;
#endif
    wp::int64* home = bucket.data + first;
    wp::int64* keys = home;
#if defined(__CUDA_ARCH__)
    if (count <= ROOM / 2 && lanes == BLOCK) {
        // By bins of equal width between the least key and the greatest: each key is then compared with those of its
        // bin only. The order in which keys come into a bin does not matter.
        __shared__ int bins[BINS + 1];
        __shared__ wp::int64 ends[2 * BLOCK / 32];
        __shared__ int sums[BLOCK / 32];
        const unsigned all = 0xffffffffu;
        wp::int64* far = near + ROOM / 2;
        wp::int64 low = home[0];
        wp::int64 high = low;
        for (int i = lane; i < count; i += BLOCK) {
            const wp::int64 key = home[i];
            near[i] = key;
            low = key < low ? key : low;
            high = key > high ? key : high;
        }
        for (int away = 16; away > 0; away /= 2) {
            const wp::int64 lower = __shfl_xor_sync(all, low, away);
            const wp::int64 higher = __shfl_xor_sync(all, high, away);
            low = lower < low ? lower : low;
            high = higher > high ? higher : high;
        }
        if ((lane & 31) == 0) {
            ends[lane / 32] = low;
            ends[BLOCK / 32 + lane / 32] = high;
        }
        bins[2 * lane] = 0;
        bins[2 * lane + 1] = 0;
        __syncthreads();
        for (int warp = 0; warp < BLOCK / 32; ++warp) {
            low = ends[warp] < low ? ends[warp] : low;
            high = ends[BLOCK / 32 + warp] > high ? ends[BLOCK / 32 + warp] : high;
        }
        // Rounding keeps the order: no key comes into a bin before that of a smaller one.
        const float scale = (float)BINS / ((float)(high - low) + 1.0f);
        auto bin_of = [&](wp::int64 key) {
            const int bin = (int)((float)(key - low) * scale);
            return bin < BINS ? bin : BINS - 1;
        };
        int slots[ROOM / 2 / BLOCK];
        #pragma unroll
        for (int k = 0; k < ROOM / 2 / BLOCK; ++k)
            if (lane + k * BLOCK < count) slots[k] = atomicAdd(bins + bin_of(near[lane + k * BLOCK]), 1);
        __syncthreads();
        const int here = bins[2 * lane];
        const int next = bins[2 * lane + 1];
        int through = here + next;
        for (int away = 1; away < 32; away *= 2) {
            const int other = __shfl_up_sync(all, through, away);
            if ((lane & 31) >= away) through += other;
        }
        if ((lane & 31) == 31) sums[lane / 32] = through;
        if (!__syncthreads_or(here > MOST_OF_BIN || next > MOST_OF_BIN)) {
            int before = through - here - next;
            for (int warp = 0; warp < lane / 32; ++warp) before += sums[warp];
            bins[2 * lane] = before;
            bins[2 * lane + 1] = before + here;
            if (lane == 0) bins[BINS] = count;
            __syncthreads();
            #pragma unroll
            for (int k = 0; k < ROOM / 2 / BLOCK; ++k)
                if (lane + k * BLOCK < count) {
                    const wp::int64 key = near[lane + k * BLOCK];
                    far[bins[bin_of(key)] + slots[k]] = key;
                }
            __syncthreads();
            for (int i = lane; i < count; i += BLOCK) {
                const wp::int64 key = far[i];
                const int bin = bin_of(key);
                const int end = bins[bin + 1];
                int place = bins[bin];
                for (int j = bins[bin]; j < end; ++j) place += far[j] < key || (far[j] == key && j < i);
                near[place] = key;
            }
            __syncthreads();
            for (int i = lane; i < count; i += BLOCK) home[i] = near[i];
            return;
        }
    }
    if (count <= ROOM) {
        keys = near;
        for (int i = lane; i < count; i += lanes) keys[i] = home[i];
    }
    __syncthreads();
#endif
    int pairs = 1;
    while (2 * pairs < count) pairs *= 2;
    for (int run = 2; run <= 2 * pairs; run *= 2)
        for (int apart = run / 2; apart > 0; apart /= 2) {
            for (int pair = lane; pair < pairs; pair += lanes) {
                // First each key of a run's first half with its mirror image in the second, then halves of halves. All
                // put the smaller one first, so that what would be behind the last key stays there, and is left out.
                const int a = 2 * pair - (pair & (apart - 1));
                const int b = 2 * apart == run ? a + run - 1 - 2 * (pair & (apart - 1)) : a + apart;
                if (b < count && keys[a] > keys[b]) {
                    const wp::int64 one = keys[a];
                    keys[a] = keys[b];
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
    if (count <= ROOM)
        for (int i = lane; i < count; i += lanes) home[i] = keys[i];
#endif
"""
for _name, _value in (("ROOM", ROOM), ("BLOCK", BLOCK), ("BINS", BINS), ("MOST_OF_BIN", MOST_OF_BIN)):
    SORT = SORT.replace(_name, str(_value))


@wp.func_native(SORT)
def sort_bucket(bucket: wp.array(dtype=wp.int64), first: wp.int32, count: wp.int32):
    """Sorts the `count` keys from `first` on, by all threads of a block: by bins, and where these are crowded, or there
    are many, by comparing pairs (bitonic sort, Batcher 1968).

    Of up to ROOM keys, thread i of n then finds the keys i, i + n, ... in their places.
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
        sensor, call, frames: as in pipeline.Source.
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
        sensor: as in pipeline.Source.
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
    crowded = bool(False)
    b = begin
    while b < end:
        count = filled[b]
        first[b] = place
        if b % of_env == 0:
            head[OFFSETS + b // of_env] = wp.int64(place)
        crowded = crowded or count > wp.static(CROWD)
        place += count
        b += 1
    if end == length and begin < end:
        first[length] = place
        head[OFFSETS + length // of_env] = wp.int64(place)
        for i in range(wp.static(COUNTS)):
            head[i] = counters[i]
            following[i] = wp.int64(0)
        following[FULL_FROM] = wp.int64(wp.static(NOWHERE))
        if counters[BLOCKED] != wp.int64(0):
            head[STATUS] = wp.int64(wp.static(SKIPPED))
        elif counters[EVENTS] > sensor.capacity:
            head[STATUS] = wp.int64(wp.static(OUTGROWN))
    if crowded:
        head[STATUS] = wp.int64(wp.static(CROWDED))


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
):
    """Puts events into buckets, int64 [capacity]; arguments as of count_events and place_buckets."""
    count = listed(sensor, counters)
    i = wp.tid()
    while i < count:
        key = keys[i]
        buckets[first[bucket_of(sensor, call, frames, stamped, of_env, key)] + slots[i]] = key
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
    """Puts the events of each bucket in order; a block is a bucket.

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
        sort_bucket(buckets, start, count)
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
