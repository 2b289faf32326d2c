"""Sorts samples by pixel and time."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.path_kernels import PARTS

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


@cache
def make_sort(channels: int) -> wp.Kernel:
    """Makes the kernel that sorts the samples of pixels by time. channels: 1 (luminance) or 3 (RGB)."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3

    @wp.kernel(module="unique", enable_backward=False)
    def sort(
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
        t = instants[j]
        place = first[q]
        for k in range(first[q], first[q + 1]):
            if instants[order[k]] < t:
                place += 1
        env = q // inner
        i = t // PARTS
        part = t % PARTS
        ns = wp.int32(0)
        if i > 0:
            ns = since[env, i - 1]
        if part > 0:
            ns += (since[env, i] - ns) * part // PARTS
        offset[place] = ns
        value[place] = values[j]

    return sort
