"""Sorts keys by the threads of one block."""

import re

import warp as wp

wp.set_module_options({"enable_backward": False})

BLOCK = 256
"""Threads of a block that sorts a bucket."""
ROOM = 1 << 11
"""Events of a bucket up to which a block sorts in the memory of its own."""
MOST = 1 << 15
"""Events of a bucket that a block sorts."""
BINS = 2 * BLOCK
"""Parts that a block divides a range of keys into."""
MOST_OF_BIN = 256
"""Keys of one of them up to which each is compared with all the others; more are divided once more."""

SORT = """
#if defined(__CUDA_ARCH__)
    #define BLOCK_SHARED __shared__
    #define BLOCK_WAITS __syncthreads()
    const int lane = threadIdx.x;
    const int lanes = BLOCK;
    auto added = [](int* place, int n) { return atomicAdd(place, n); };
#else
    #define BLOCK_SHARED
    #define BLOCK_WAITS
    const int lane = 0;
    const int lanes = 1;
    auto added = [](int* place, int n) { const int before = *place; *place = before + n; return before; };
#endif
    BLOCK_SHARED wp::int64 near[ROOM];
    BLOCK_SHARED wp::int64 far[ROOM];
    BLOCK_SHARED int bins[BINS];
    BLOCK_SHARED int begins[MOST / MOST_OF_BIN];
    BLOCK_SHARED int ends[MOST / MOST_OF_BIN];
    BLOCK_SHARED int waiting;
#if defined(__CUDA_ARCH__)
    __shared__ wp::int64 extremes[2 * BLOCK / 32];
    __shared__ int sums[BLOCK / 32];
    const unsigned all = 0xffffffffu;
#endif
    // Ranges of keys that wait lie apart and hold more than MOST_OF_BIN each, but for the first.
    auto sort = [&](wp::int64* keys, wp::int64* other) {
        while (waiting > 0) {
            const int begin = begins[waiting - 1];
            const int end = ends[waiting - 1];
            wp::int64 low = keys[begin];
            wp::int64 high = low;
            for (int i = begin + lane; i < end; i += lanes) {
                low = keys[i] < low ? keys[i] : low;
                high = keys[i] > high ? keys[i] : high;
            }
            for (int b = lane; b < BINS; b += lanes) bins[b] = 0;
#if defined(__CUDA_ARCH__)
            for (int away = 16; away > 0; away /= 2) {
                const wp::int64 lower = __shfl_xor_sync(all, low, away);
                const wp::int64 higher = __shfl_xor_sync(all, high, away);
                low = lower < low ? lower : low;
                high = higher > high ? higher : high;
            }
            if ((lane & 31) == 0) {
                extremes[lane / 32] = low;
                extremes[BLOCK / 32 + lane / 32] = high;
            }
            __syncthreads();
            for (int warp = 0; warp < BLOCK / 32; ++warp) {
                low = extremes[warp] < low ? extremes[warp] : low;
                high = extremes[BLOCK / 32 + warp] > high ? extremes[BLOCK / 32 + warp] : high;
            }
#endif
            if (lane == 0) --waiting;
            if (low < high) {
                // Bins of equal width between the least key and the greatest, which come into different ones, so that a
                // range is divided each time. Rounding keeps the order.
                const float scale = (float)BINS / ((float)(high - low) + 1.0f);
                auto bin_of = [&](wp::int64 key) {
                    const int bin = (int)((float)(key - low) * scale);
                    return bin < BINS ? bin : BINS - 1;
                };
                for (int i = begin + lane; i < end; i += lanes) added(bins + bin_of(keys[i]), 1);
                BLOCK_WAITS;
                const int each = BINS / lanes;
                int here = 0;
                for (int b = lane * each; b < (lane + 1) * each; ++b) here += bins[b];
                int before = begin;
#if defined(__CUDA_ARCH__)
                int through = here;
                for (int away = 1; away < 32; away *= 2) {
                    const int less = __shfl_up_sync(all, through, away);
                    if ((lane & 31) >= away) through += less;
                }
                if ((lane & 31) == 31) sums[lane / 32] = through;
                __syncthreads();
                for (int warp = 0; warp < lane / 32; ++warp) before += sums[warp];
                before += through - here;
#endif
                for (int b = lane * each; b < (lane + 1) * each; ++b) {
                    const int of_bin = bins[b];
                    bins[b] = before;
                    before += of_bin;
                }
                BLOCK_WAITS;
                // The order in which keys come into a bin does not matter. Afterwards bins[b] is where bin b ends.
                for (int i = begin + lane; i < end; i += lanes) other[added(bins + bin_of(keys[i]), 1)] = keys[i];
                BLOCK_WAITS;
                for (int i = begin + lane; i < end; i += lanes) {
                    const wp::int64 key = other[i];
                    const int bin = bin_of(key);
                    const int from = bin > 0 ? bins[bin - 1] : begin;
                    const int to = bins[bin];
                    int place = i;
                    if (to - from <= MOST_OF_BIN) {
                        place = from;
                        for (int j = from; j < to; ++j) place += other[j] < key || (other[j] == key && j < i);
                    }
                    keys[place] = key;
                }
                for (int b = lane; b < BINS; b += lanes) {
                    const int from = b > 0 ? bins[b - 1] : begin;
                    if (bins[b] - from > MOST_OF_BIN) {
                        const int place = added(&waiting, 1);
                        begins[place] = from;
                        ends[place] = bins[b];
                    }
                }
            }
            BLOCK_WAITS;
        }
    };
    wp::int64* home = bucket.data + first;
    if (lane == 0) {
        begins[0] = 0;
        ends[0] = count;
        waiting = 1;
    }
    if (count <= ROOM)
        for (int i = lane; i < count; i += lanes) near[i] = home[i];
    BLOCK_WAITS;
    // Apart, so that a compiler knows which memory it is.
    if (count <= ROOM) {
        sort(near, far);
        for (int i = lane; i < count; i += lanes) home[i] = near[i];
    } else {
        sort(home, spare.data + first);
    }
    #undef BLOCK_SHARED
    #undef BLOCK_WAITS
"""
for _name, _value in (("BLOCK", BLOCK), ("ROOM", ROOM), ("MOST", MOST), ("BINS", BINS), ("MOST_OF_BIN", MOST_OF_BIN)):
    SORT = re.sub(rf"\b{_name}\b", str(_value), SORT)


@wp.func_native(SORT)
def sort_bucket(bucket: wp.array(dtype=wp.int64), spare: wp.array(dtype=wp.int64), first: wp.int32, count: wp.int32):
    """Sorts the `count` keys from `first` on, at most MOST, by the BLOCK threads of a block; the same places of `spare`
    may be written over.

    A range of keys is divided into bins between its least and its greatest; within a bin with few keys each is compared
    with the others, one with many is a range of its own. Thread i of n then finds keys i, i + n, ... in their places.
    """
    ...
