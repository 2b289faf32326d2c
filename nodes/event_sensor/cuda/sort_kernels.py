"""Keys put in order by the threads of one block."""

import warp as wp

wp.set_module_options({"enable_backward": False})

ROOM = 1 << 12
"""Events of a bucket up to which a block sorts in the memory of its own."""
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
