"""A place in a shared list, taken by a warp at once: its threads do not wait for each other at the one counter."""

import warp as wp

wp.set_module_options({"enable_backward": False})

COUNT_LANES = """
#if defined(__CUDA_ARCH__)
    const unsigned lanes = __activemask();
    const unsigned before = lanes & ((1u << (threadIdx.x & 31)) - 1u);
    int first = 0;
    if (before == 0)
        first = atomicAdd(counts.data + at, __popc(lanes));
    return __shfl_sync(lanes, first, __ffs(lanes) - 1) + __popc(before);
#else
    const int first = counts.data[at];
    counts.data[at] = first + 1;
    return first;
#endif
"""


@wp.func_native(COUNT_LANES)
def take_place(counts: wp.array(dtype=wp.int32), at: wp.int32) -> wp.int32:
    """Add 1 to counts[at]; returns this thread's number. All threads that get here together must give the same `at`. On
    a CPU no two threads may share a counter."""
    ...
