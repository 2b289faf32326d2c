"""Appends to a list that many threads share: a warp takes the places of all its active threads at once.

Every thread that takes a place by an atomic of its own pays for it one after the other at the one address; a warp whose
active threads add up first pays once. On a CPU, where threads run one after the other, it is an addition, and no two
threads may share a counter.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

COUNT_ACTIVE = """
#if defined(__CUDA_ARCH__)
    const unsigned active = __activemask();
    const unsigned before = active & ((1u << (threadIdx.x & 31)) - 1u);
    auto first = decltype(+*counts.data)(0);
    if (before == 0)
        first = wp::atomic_add(counts.data + place, decltype(first)(__popc(active)));
    return __shfl_sync(active, first, __ffs(active) - 1) + __popc(before);
#else
    const auto first = counts.data[place];
    counts.data[place] = first + 1;
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

ADD_UP = """
#if defined(__CUDA_ARCH__)
    const unsigned active = __activemask();
    const int mine = threadIdx.x & 31;
    const int leader = __ffs(active) - 1;
    int before = 0;
    int total = 0;
    // Numbers are small: bit by bit, what the threads before this one have, and all.
    for (int bit = 0; __any_sync(active, n >> bit); ++bit) {
        const unsigned set = __ballot_sync(active, (n >> bit) & 1);
        before += __popc(set & ((1u << mine) - 1u)) << bit;
        total += __popc(set) << bit;
    }
    unsigned long long first = 0;
    if (mine == leader)
        first = atomicAdd(
            reinterpret_cast<unsigned long long*>(counts.data) + place, (unsigned long long)total);
    first = __shfl_sync(active, first, leader);
    return (wp::int64)first + before;
#else
    const wp::int64 first = counts.data[place];
    counts.data[place] = first + n;
    return first;
#endif
"""


@wp.func_native(COUNT_ACTIVE)
def take_place(counts: wp.array(dtype=wp.int32), place: wp.int32) -> wp.int32:
    """Adds 1 to counts[place]; returns this thread's number. All threads that get here together give the same place."""
    ...


@wp.func_native(COUNT_ACTIVE)
def take_place_of_many(counts: wp.array(dtype=wp.int64), place: wp.int32) -> wp.int64:
    """Takes a place of a list as `take_place` does, with counts of 64 bits."""
    ...


@wp.func_native(COUNT_PEERS)
def take_place_at(counts: wp.array(dtype=wp.int32), place: wp.int32) -> wp.int32:
    """Adds 1 to counts[place], a place for each thread; returns this thread's number there."""
    ...


@wp.func_native(ADD_UP)
def take_room(counts: wp.array(dtype=wp.int64), place: wp.int32, n: wp.int32) -> wp.int64:
    """Adds n to counts[place]; returns where this thread's n begin."""
    ...
