# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Makes the sub-frames of a gap on a CPU, one after the other: one serial scatter per environment, B's sources first,
then A's into the holes. The equations are in warp_kernels."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.splat.cpu_source_kernels import make_sources
from nodes.interpolator.splat.cpu_sum_kernels import make_scratch, mean, reset, splat_a, splat_b, weight_of, weighted
from nodes.interpolator.splat.warp_kernels import (
    EMPTY,
    SUBPIXEL,
    background,
    counts_as_filled,
    padded,
    same_surface,
    share_gone,
)

wp.set_module_options({"enable_backward": False})


@wp.func
def total_of(
    env: int, pixel: int, at: int, still: wp.array2d(dtype=wp.float32), image: wp.array2d(dtype=Any),
    nearest: wp.array(dtype=wp.float32), sums: wp.array(dtype=Any),
):  # fmt: skip
    """Adds to the sum at a target the source that stays there, whose weight is one pixel."""
    total = sums[at]
    z = still[env, at]
    if z < EMPTY and same_surface(z, nearest[at]):
        total = total + weighted(image[env, pixel], float(SUBPIXEL * SUBPIXEL))
    return total


@wp.func
def resolve_b(
    env: int, row: int, box: wp.vec4i, width: int, keyframe: Any, scratch: Any, frames: wp.array2d(dtype=Any),
):  # fmt: skip
    """Writes the box of one frame and lists the pixels without any source in `holes`. Returns how many there are."""
    still = keyframe.still
    image = keyframe.image
    nearest = scratch.nearest
    sums = scratch.sums
    holes = scratch.holes
    n = int(0)
    y = box[1]
    while y <= box[3]:
        x = box[0]
        while x <= box[2]:
            pixel = y * width + x
            total = total_of(env, pixel, (y + 1) * (width + 2) + x + 1, still, image, nearest, sums)
            if weight_of(total) > 0.0:
                frames[row, pixel] = mean(total)
            else:
                holes[n] = pixel
                n += 1
            x += 1
        y += 1
    return n


@wp.func
def resolve_a(
    env: int, row: int, count: int, width: int, keyframe: Any, scratch: Any, frames: wp.array2d(dtype=Any),
):  # fmt: skip
    """Writes the holes that A saw and keeps the others in `holes`. Returns how many; their depth in `nearest` is -1."""
    still = keyframe.still
    image = keyframe.image
    nearest_a = scratch.nearest_a
    sums = scratch.sums
    nearest = scratch.nearest
    holes = scratch.holes
    n = int(0)
    j = int(0)
    while j < count:
        pixel = holes[j]
        at = padded(pixel, width)
        total = total_of(env, pixel, at, still, image, nearest_a, sums)
        nearest[at] = nearest_a[at]
        nearest_a[at] = 0.0
        if weight_of(total) > 0.0:
            frames[row, pixel] = mean(total)
        else:
            nearest[at] = -1.0
            holes[n] = pixel
            n += 1
        j += 1
    return n


@cache
def make_warp_gap(channels: int) -> wp.Kernel:
    """Makes the kernel `warp_gap`; channels: 1 (luminance) or 3 (RGB)."""
    pixel = pixel_type(channels)
    KeyframeSources: Any = make_sources(channels)
    Scratch: Any = make_scratch(channels)

    @wp.kernel(module="unique", enable_backward=False)
    def warp_gap(
        # in
        first: int,
        last: int,
        upsampling: int,
        width: int,
        height: int,
        margin: int,
        a: KeyframeSources,
        b: KeyframeSources,
        scratch: Scratch,
        # out
        frames: wp.array2d(dtype=pixel),
        filled: wp.array(dtype=wp.int32),
    ):
        """Makes sub-frames first .. last - 1 of one environment's gap, equations (5) to (7), B first and A into its
        holes.

        frames comes filled with B's own image, and only the box that B's moving pixels sweep is written. filled counts
        the pixels of each frame, margin apart, that neither keyframe saw.
        """
        env = wp.tid()
        box = wp.vec4i(b.counts[env, 1], b.counts[env, 2], b.counts[env, 3], b.counts[env, 4])
        at = int(0)
        while at < (width + 2) * (height + 2):
            scratch.nearest[at] = b.still[env, at]
            scratch.nearest_a[at] = 0.0
            at += 1
        for i in range(first, last):
            row = env * upsampling + i - 1
            reset(env, box, width, b.still, scratch.nearest, scratch.sums)
            splat_b(env, share_gone(i, upsampling, 1), width, height, b, scratch)
            filled[row] = 0
            n = resolve_b(env, row, box, width, b, scratch, frames)
            if n > 0:
                j = int(0)
                while j < n:
                    at = padded(scratch.holes[j], width)
                    scratch.nearest_a[at] = a.still[env, at]
                    j += 1
                splat_a(env, share_gone(i, upsampling, 0), width, height, a, scratch)
                n = resolve_a(env, row, n, width, a, scratch, frames)
                j = int(0)
                while j < n:
                    hole = scratch.holes[j]
                    if counts_as_filled(hole, width, height, margin):
                        filled[row] = filled[row] + 1
                    known = background(scratch.nearest, hole, width, height)
                    if known >= 0:
                        frames[row, hole] = frames[row, known]
                    j += 1

    return warp_gap
