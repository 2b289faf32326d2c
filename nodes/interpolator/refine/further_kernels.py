"""Samples of single pixels, as they were made, sorted by pixel and time."""

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
    """Counts the samples of each pixel q, at count[q + 1]."""
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
    """Puts the number of each sample among those of its pixel, in any order."""
    j = wp.tid()
    q = pixels[j]
    order[first[q] + wp.atomic_add(taken, q, 1)] = j


@cache
def make_sort(channels: int) -> wp.Kernel:
    """Makes the kernel that sorts the samples of a pixel by time. channels: 1 (luminance) or 3 (RGB)."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3

    @wp.kernel(module="unique", enable_backward=False)
    def sort(
        # in
        inner: int,
        span: int,
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
        """Sorts the samples of `span` pixels a thread. since [E, instants]: ns after the gap's start; inner: pixels of
        an environment."""
        start = wp.tid() * span
        for q in range(start, wp.min(start + span, first.shape[0] - 1)):
            low = first[q]
            high = first[q + 1]
            for j in range(low + 1, high):
                moved = order[j]
                t = instants[moved]
                k = j
                while k > low and instants[order[wp.max(k - 1, 0)]] > t:
                    order[k] = order[k - 1]
                    k -= 1
                order[k] = moved
            for j in range(low, high):
                env = q // inner
                i = instants[order[j]] // PARTS
                part = instants[order[j]] % PARTS
                t = since[env, i - 1]
                if part > 0:
                    t += (since[env, i] - t) * part // PARTS
                offset[j] = t
                value[j] = values[order[j]]

    return sort
