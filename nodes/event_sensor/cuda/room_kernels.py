"""Room in a shared list, taken by a warp at once.

Every thread that takes room by an atomic of its own pays for it one after the other at the one address; a warp whose
active threads add up first pays once. On a CPU, where threads run one after the other, it is an addition.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

ADD_UP = """
#if defined(__CUDA_ARCH__)
    const unsigned lanes = __activemask();
    const int mine = threadIdx.x & 31;
    const int leader = __ffs(lanes) - 1;
    int before = 0;
    int total = 0;
    // Numbers are small: bit by bit, what the lanes before this one have, and all.
    for (int bit = 0; __any_sync(lanes, n >> bit); ++bit) {
        const unsigned set = __ballot_sync(lanes, (n >> bit) & 1);
        before += __popc(set & ((1u << mine) - 1u)) << bit;
        total += __popc(set) << bit;
    }
    unsigned long long first = 0;
    if (mine == leader)
        first = atomicAdd(
            reinterpret_cast<unsigned long long*>(counters.data) + place, (unsigned long long)total);
    first = __shfl_sync(lanes, first, leader);
    return (wp::int64)first + before;
#else
    const wp::int64 first = counters.data[place];
    counters.data[place] = first + n;
    return first;
#endif
"""

COUNT_LANES = """
#if defined(__CUDA_ARCH__)
    const unsigned lanes = __activemask();
    const int mine = threadIdx.x & 31;
    const int leader = __ffs(lanes) - 1;
    unsigned long long first = 0;
    if (mine == leader)
        first = atomicAdd(
            reinterpret_cast<unsigned long long*>(counters.data) + place, (unsigned long long)__popc(lanes));
    first = __shfl_sync(lanes, first, leader);
    return (wp::int64)first + __popc(lanes & ((1u << mine) - 1u));
#else
    const wp::int64 first = counters.data[place];
    counters.data[place] = first + 1;
    return first;
#endif
"""


COUNT_PEERS = """
#if defined(__CUDA_ARCH__)
    const unsigned peers = __match_any_sync(__activemask(), place);
    const int mine = threadIdx.x & 31;
    const int leader = __ffs(peers) - 1;
    int first = 0;
    if (mine == leader) first = atomicAdd(counts.data + place, __popc(peers));
    first = __shfl_sync(peers, first, leader);
    return first + __popc(peers & ((1u << mine) - 1u));
#else
    const int first = counts.data[place];
    counts.data[place] = first + 1;
    return first;
#endif
"""


@wp.func_native(ADD_UP)
def take_room(counters: wp.array(dtype=wp.int64), place: wp.int32, n: wp.int32) -> wp.int64:
    """Adds n to counters[place]; returns where this thread's n begin."""
    ...


@wp.func_native(COUNT_PEERS)
def take_place_at(counts: wp.array(dtype=wp.int32), place: wp.int32) -> wp.int32:
    """Adds 1 to counts[place], a place for each thread; returns this thread's number there."""
    ...


@wp.func_native(COUNT_LANES)
def take_place(counters: wp.array(dtype=wp.int64), place: wp.int32) -> wp.int64:
    """Adds 1 to counters[place]; returns this thread's number."""
    ...
