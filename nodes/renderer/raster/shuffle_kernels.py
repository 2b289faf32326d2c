"""Exchanges values between threads that run together: groups of 8, 16 or 32 neighbours, all of which must take part.

On a CPU a thread is a group of its own.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

RUNNING_SUM = """
#if defined(__CUDA_ARCH__)
    const unsigned lane = threadIdx.x & 31u;
    const unsigned group = (size == 32 ? 0xffffffffu : ((1u << size) - 1u) << (lane & ~(size - 1u)));
    int sum = value;
    for (int step = 1; step < size; step *= 2) {
        const int before = __shfl_up_sync(group, sum, step, size);
        if ((lane & (size - 1u)) >= (unsigned)step)
            sum += before;
    }
    return sum;
#else
    return value;
#endif
"""

SHUFFLE_FROM = """
#if defined(__CUDA_ARCH__)
    const unsigned lane = threadIdx.x & 31u;
    const unsigned group = (size == 32 ? 0xffffffffu : ((1u << size) - 1u) << (lane & ~(size - 1u)));
    return __shfl_sync(group, value, which, size);
#else
    return value;
#endif
"""

FIRST_ABOVE = """
#if defined(__CUDA_ARCH__)
    const unsigned lane = threadIdx.x & 31u;
    const unsigned group = (size == 32 ? 0xffffffffu : ((1u << size) - 1u) << (lane & ~(size - 1u)));
    int found = 0;
    for (int step = size / 2; step > 0; step /= 2) {
        if (__shfl_sync(group, sum, found + step - 1, size) <= index)
            found += step;
    }
    return found;
#else
    return 0;
#endif
"""


@wp.func_native(RUNNING_SUM)
def running_sum(value: wp.int32, size: wp.int32) -> wp.int32:
    """Sums the values of a group's threads, up to and with this one's. size: threads of a group."""
    ...


@wp.func_native(SHUFFLE_FROM)
def shuffle_from(value: wp.int32, which: wp.int32, size: wp.int32) -> wp.int32:
    """Gives the value of the group's thread `which`, counted from 0."""
    ...


@wp.func_native(FIRST_ABOVE)
def first_above(index: wp.int32, sum: wp.int32, size: wp.int32) -> wp.int32:
    """Gives the first thread of a group with sum > index, sums ascending; the last thread where there is none."""
    ...
