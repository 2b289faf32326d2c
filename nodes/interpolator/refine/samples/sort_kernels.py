"""Sorts samples by pixel and time."""

from functools import cache

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.samples.request_kernels import PARTS

wp.set_module_options({"enable_backward": False})


@wp.kernel
def count_samples(
    # in
    pixels: wp.array(dtype=int),
    # out
    count: wp.array(dtype=int),
):
    """Counts the samples of each pixel q in count[q + 1]."""
    wp.atomic_add(count, pixels[wp.tid()] + 1, 1)


@wp.kernel
def place_samples(
    # in
    pixels: wp.array(dtype=int),
    first: wp.array(dtype=int),
    # in and out
    taken: wp.array(dtype=int),
    # out
    order: wp.array(dtype=int),
):
    """Groups the numbers of the samples by pixel, in any order within a pixel."""
    j = wp.tid()
    q = pixels[j]
    order[first[q] + wp.atomic_add(taken, q, 1)] = j


@wp.kernel
def begin_at_zero(
    # in
    first: wp.array(dtype=int),
    # out
    firsts: wp.array2d(dtype=int),
    begins: wp.array(dtype=int),
):
    """Cuts `first` [E P + 1] into that of each environment by itself [E, P + 1]; begins [E]: its first sample."""
    env, q = wp.tid()
    begin = env * (firsts.shape[1] - 1)
    firsts[env, q] = first[begin + q] - first[begin]
    if q == 0:
        begins[env] = first[begin]


@cache
def make_sort(channels: int) -> tuple[wp.Kernel, wp.Kernel]:
    """Makes the kernels `sort_each`, of a thread per pixel, and `rank`, of one per sample; both write the same.

    channels: 1 (luminance) or 3 (RGB).
    """
    pixel = pixel_type(channels)

    @wp.func
    def comes_before(instants: wp.array(dtype=int), i: int, j: int):
        """Tells whether sample i is before sample j in time, or has the smaller number at the same time."""
        return instants[i] < instants[j] or (instants[i] == instants[j] and i < j)

    @wp.func
    def since_start(since: wp.array2d(dtype=int), env: int, t: int):
        """Gives the time [ns] since the gap's start, of an instant counted in PARTS."""
        i = t // PARTS
        part = t % PARTS
        ns = wp.int32(0)
        if i > 0:
            ns = since[env, i - 1]
        if part > 0:
            # Never at the instant itself, which may be a frame.
            ns += wp.max((since[env, i] - ns) * part // PARTS, 1)
        return ns

    @wp.kernel(module="unique", enable_backward=False)
    def sort_each(
        # in
        q0: int,
        inner: int,
        first: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        values: wp.array(dtype=pixel),
        since: wp.array2d(dtype=int),
        # in and out
        order: wp.array(dtype=int),
        # out
        offset: wp.array(dtype=int),
        value: wp.array(dtype=pixel),
    ):
        """Sorts the samples of each pixel from q0 on by Shell's method; other arguments as of `rank`."""
        q = q0 + wp.tid()
        start = first[q]
        end = first[q + 1]
        stride = (end - start) // 2
        while stride > 0:
            for k in range(start + stride, end):
                j = order[k]
                place = k
                while place >= start + stride and comes_before(instants, j, order[place - stride]):
                    order[place] = order[place - stride]
                    place -= stride
                order[place] = j
            stride = stride // 2
        for k in range(start, end):
            offset[k] = since_start(since, q // inner, instants[order[k]])
            value[k] = values[order[k]]

    @wp.kernel(module="unique", enable_backward=False)
    def rank(
        # in
        inner: int,
        first: wp.array(dtype=int),
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        values: wp.array(dtype=pixel),
        since: wp.array2d(dtype=int),
        order: wp.array(dtype=int),
        # out
        offset: wp.array(dtype=int),
        value: wp.array(dtype=pixel),
    ):
        """Writes each sample to its place in time among those of its pixel.

        inner: pixels of an environment. since: [E, instants], ns from the gap's start. order: samples by pixel.
        """
        j = order[wp.tid()]
        q = pixels[j]
        place = first[q]
        for k in range(first[q], first[q + 1]):
            if comes_before(instants, order[k], j):
                place += 1
        offset[place] = since_start(since, q // inner, instants[j])
        value[place] = values[j]

    return sort_each, rank
