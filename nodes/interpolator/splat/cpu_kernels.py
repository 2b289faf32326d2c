# ruff: noqa: RUF046, F811 - int(0) declares a variable that changes; functions are overloaded by their types
"""Schedules the warp on a CPU: one serial scatter per environment. Its equations are in warp_kernels.

A CPU launch runs its threads one after the other, so plain sums in the order of the sources are deterministic. Inner
loops are `while`: Warp's `range` costs 1.5 ns per turn on a CPU, a `while` 0.1 ns.
"""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.splat.warp_kernels import (
    EMPTY,
    SUBPIXEL,
    Source,
    Target,
    background,
    bent,
    bilinear,
    can_land,
    counts_as_filled,
    depth_at,
    fraction,
    known_depth,
    padded,
    same_surface,
    source_of,
    stays_put,
    target_of,
)

wp.set_module_options({"enable_backward": False})


@wp.kernel
def collect(
    # in
    sign: wp.float32,
    held: wp.array(dtype=wp.int32),
    depth: wp.array3d(dtype=wp.float32),
    other_depth: wp.array3d(dtype=wp.float32),
    motion: wp.array4d(dtype=wp.float32),
    bends: wp.array2d(dtype=wp.vec2),
    counts_b: wp.array2d(dtype=wp.int32),
    # out
    still: wp.array2d(dtype=wp.float32),
    sources: wp.array2d(dtype=Source),
    counts: wp.array2d(dtype=wp.int32),
):
    """Splits a keyframe's pixels into those that stay (their depth, on the padded grid) and those that move.

    sign: +1 for B (it goes back along its motion), -1 for A. counts per environment: moving sources, then the box of
    their paths (x0, y0, x1, y1, inclusive), then sources without finite motion. A is left out where B's box is empty.
    """
    env = wp.tid()
    counts[env, 0] = 0
    counts[env, 5] = 0
    if sign < 0.0 and counts_b[env, 3] < 0:
        return
    hold = held[env]
    height = depth.shape[1]
    width = depth.shape[2]
    n = int(0)
    lost = int(0)
    x0 = width
    y0 = height
    x1 = int(-1)
    y1 = int(-1)
    y = int(0)
    while y < height:
        x = int(0)
        while x < width:
            dx = sign * motion[env, y, x, 0]
            dy = sign * motion[env, y, x, 1]
            z = depth[env, y, x]
            own = known_depth(z)
            at = (y + 1) * (width + 2) + x + 1
            bend = wp.vec2(0.0, 0.0)
            if bends.shape[1] > 0:
                bend = bends[env, y * width + x]
            straight = bend[0] == 0.0 and bend[1] == 0.0
            if stays_put(hold, straight, dx, dy, z, other_depth[env, y, x]):
                still[env, at] = own
            else:
                still[env, at] = EMPTY
                fx = float(x) + dx
                fy = float(y) + dy
                x0 = wp.min(x0, x)
                y0 = wp.min(y0, y)
                x1 = wp.max(x1, x)
                y1 = wp.max(y1, y)
                if can_land(dx, dy):
                    # A parabola is at most a quarter of its bend off the straight line.
                    bx = 0.25 * wp.abs(bend[0])
                    by = 0.25 * wp.abs(bend[1])
                    x0 = wp.min(x0, wp.int32(wp.max(wp.min(fx, float(x)) - bx, 0.0)))
                    y0 = wp.min(y0, wp.int32(wp.max(wp.min(fy, float(y)) - by, 0.0)))
                    x1 = wp.max(x1, wp.int32(wp.min(wp.max(fx, float(x)) + bx + 1.0, float(width - 1))))
                    y1 = wp.max(y1, wp.int32(wp.min(wp.max(fy, float(y)) + by + 1.0, float(height - 1))))
                    sources[env, n] = source_of(other_depth, env, x, y, y * width + x, dx, dy, own)
                    n += 1
                elif not (wp.isfinite(dx) and wp.isfinite(dy)):
                    lost += 1
            x += 1
        y += 1
    counts[env, 0] = n
    counts[env, 1] = x0
    counts[env, 2] = y0
    counts[env, 3] = x1
    counts[env, 4] = y1
    counts[env, 5] = lost


@wp.func
def weighted(value: wp.float32, weight: wp.float32):
    """Puts a weighted value and its weight together, as sums are kept; in colour three values and the weight."""
    return wp.vec2(weight * value, weight)


@wp.func
def weighted(value: wp.vec3, weight: wp.float32):
    return wp.vec4(weight * value[0], weight * value[1], weight * value[2], weight)


@wp.func
def weight_of(total: wp.vec2):
    """Reads the weight of a sum."""
    return total[1]


@wp.func
def weight_of(total: wp.vec4):
    return total[3]


@wp.func
def mean(total: wp.vec2):
    """Divides a sum by its weight, equation (7)."""
    return total[0] / total[1]


@wp.func
def mean(total: wp.vec4):
    return wp.vec3(total[0] / total[3], total[1] / total[3], total[2] / total[3])


@wp.func
def lower(nearest: wp.array(dtype=wp.float32), at: int, z: wp.float32):
    """Keeps the smaller depth of a target."""
    nearest[at] = wp.min(nearest[at], z)


@wp.func
def lower_all(nearest: wp.array(dtype=wp.float32), target: Target, z: wp.float32):
    """Keeps the smaller depth of the four pixels of a target."""
    lower(nearest, target.at, z)
    lower(nearest, target.at + target.right, z)
    lower(nearest, target.at + target.down, z)
    lower(nearest, target.at + target.right + target.down, z)


@wp.func
def add(nearest: wp.array(dtype=wp.float32), sums: wp.array(dtype=Any), at: int, z: wp.float32, term: Any):
    """Adds a source to a target's sum if it belongs to the surface that is nearest there."""
    if same_surface(z, nearest[at]):
        sums[at] = sums[at] + term


@wp.func
def add_all(nearest: wp.array(dtype=wp.float32), sums: wp.array(dtype=Any), target: Target, z: wp.float32, value: Any):
    """Adds a source to the sums of the four pixels of its target, with their bilinear weights."""
    at = target.at
    x = target.fx
    y = target.fy
    add(nearest, sums, at, z, weighted(value, float(bilinear(x, y, 0, 0))))
    add(nearest, sums, at + target.right, z, weighted(value, float(bilinear(x, y, 1, 0))))
    add(nearest, sums, at + target.down, z, weighted(value, float(bilinear(x, y, 0, 1))))
    add(nearest, sums, at + target.right + target.down, z, weighted(value, float(bilinear(x, y, 1, 1))))


@wp.func
def reset(
    env: int, box: wp.vec4i, width: int, still: wp.array2d(dtype=wp.float32),
    nearest: wp.array(dtype=wp.float32), sums: wp.array(dtype=Any),
):  # fmt: skip
    """Starts a sub-frame from the pixels that stay."""
    y = box[1]
    while y <= box[3]:
        at = (y + 1) * (width + 2) + box[0] + 1
        end = at + box[2] - box[0]
        while at <= end:
            nearest[at] = still[env, at]
            sums[at] = sums.dtype(0.0)
            at += 1
        y += 1


@wp.func
def splat_b(
    env: int, a: wp.float32, width: int, height: int, keyframe: Any, scratch: Any,
):  # fmt: skip
    """Splats all moving sources of B: the nearest depth of every target first, then the sums of those as near.

    keyframe: of make_sources. scratch: of make_scratch.
    """
    count = keyframe.counts[env, 0]
    sources = keyframe.sources
    bends = keyframe.bends
    image = keyframe.image
    nearest = scratch.nearest
    sums = scratch.sums
    j = int(0)
    while j < count:
        source = sources[env, j]
        target = target_of(bent(source, a, env, bends), a, width, height)
        if target.at >= 0:
            lower_all(nearest, target, depth_at(source, a))
        j += 1
    j = int(0)
    while j < count:
        source = sources[env, j]
        target = target_of(bent(source, a, env, bends), a, width, height)
        if target.at >= 0:
            add_all(nearest, sums, target, depth_at(source, a), image[env, source.pixel])
        j += 1


@wp.func
def splat_a(
    env: int, a: wp.float32, width: int, height: int, keyframe: Any, scratch: Any,
):  # fmt: skip
    """Splats A's sources as splat_b does B's, into holes only; other targets hold depth 0, which nothing beats."""
    count = keyframe.counts[env, 0]
    sources = keyframe.sources
    bends = keyframe.bends
    image = keyframe.image
    nearest = scratch.nearest_a
    sums = scratch.sums
    hits = scratch.hits
    n = int(0)
    j = int(0)
    while j < count:
        source = sources[env, j]
        target = target_of(bent(source, a, env, bends), a, width, height)
        if target.at >= 0:
            at = target.at
            here = wp.max(nearest[at], nearest[at + target.right])
            below = wp.max(nearest[at + target.down], nearest[at + target.down + target.right])
            if here > 0.0 or below > 0.0:
                lower_all(nearest, target, depth_at(source, a))
                hits[n] = j
                n += 1
        j += 1
    h = int(0)
    while h < n:
        source = sources[env, hits[h]]
        target = target_of(bent(source, a, env, bends), a, width, height)
        add_all(nearest, sums, target, depth_at(source, a), image[env, source.pixel])
        h += 1


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
def make_sources(channels: int) -> Any:
    """Makes the struct of a keyframe's pixels as sources; channels: 1 (luminance) or 3 (RGB).

    image: values [E, H W]. still, sources, counts: as `collect` writes them. bends: of the paths [E, H W] px, empty
    where they are straight.
    """
    pixel = pixel_type(channels)

    class KeyframeSources:
        image: wp.array2d(dtype=pixel)
        still: wp.array2d(dtype=wp.float32)
        sources: wp.array2d(dtype=Source)
        bends: wp.array2d(dtype=wp.vec2)
        counts: wp.array2d(dtype=wp.int32)

    KeyframeSources.__qualname__ = f"KeyframeSources{channels}"
    return wp.struct(KeyframeSources)


@cache
def make_scratch(channels: int) -> Any:
    """Makes the struct of what a thread works in; channels: 1 (luminance) or 3 (RGB).

    On the padded grid: nearest depth [m] of B's sources and then of all, nearest_a of A's in holes, and weighted sums.
    Lists: holes, pixels without any source; hits, A's sources that reach one.
    """
    total: Any = wp.vec2 if channels == 1 else wp.vec4

    class Scratch:
        nearest: wp.array(dtype=wp.float32)
        nearest_a: wp.array(dtype=wp.float32)
        sums: wp.array(dtype=total)
        holes: wp.array(dtype=wp.int32)
        hits: wp.array(dtype=wp.int32)

    Scratch.__qualname__ = f"Scratch{channels}"
    return wp.struct(Scratch)


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
            splat_b(env, fraction(i, upsampling, 1), width, height, b, scratch)
            filled[row] = 0
            n = resolve_b(env, row, box, width, b, scratch, frames)
            if n > 0:
                j = int(0)
                while j < n:
                    at = padded(scratch.holes[j], width)
                    scratch.nearest_a[at] = a.still[env, at]
                    j += 1
                splat_a(env, fraction(i, upsampling, 0), width, height, a, scratch)
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
