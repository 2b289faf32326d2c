# ruff: noqa: RUF046, F811 - int(0) declares a variable that changes; functions are overloaded by their types
"""Sums sources where they land, on a CPU: the nearest depth of every target first, then those that are as near.

A CPU launch runs its threads one after the other, so plain sums in the order of the sources are deterministic. Inner
loops are `while`: Warp's `range` costs 1.5 ns per turn on a CPU, a `while` 0.1 ns.
"""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.splat.warp_kernels import Target, bent, bilinear, depth_at, same_surface, target_of

wp.set_module_options({"enable_backward": False})


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
    env: int, share: wp.float32, width: int, height: int, keyframe: Any, scratch: Any,
):  # fmt: skip
    """Splats all moving sources of B: the nearest depth of every target first, then the sums of those as near.

    share: of their way that they have gone. keyframe: of make_sources. scratch: of make_scratch.
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
        target = target_of(bent(source, share, env, bends), share, width, height)
        if target.at >= 0:
            lower_all(nearest, target, depth_at(source, share))
        j += 1
    j = int(0)
    while j < count:
        source = sources[env, j]
        target = target_of(bent(source, share, env, bends), share, width, height)
        if target.at >= 0:
            add_all(nearest, sums, target, depth_at(source, share), image[env, source.pixel])
        j += 1


@wp.func
def splat_a(
    env: int, share: wp.float32, width: int, height: int, keyframe: Any, scratch: Any,
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
        target = target_of(bent(source, share, env, bends), share, width, height)
        if target.at >= 0:
            at = target.at
            here = wp.max(nearest[at], nearest[at + target.right])
            below = wp.max(nearest[at + target.down], nearest[at + target.down + target.right])
            if here > 0.0 or below > 0.0:
                lower_all(nearest, target, depth_at(source, share))
                hits[n] = j
                n += 1
        j += 1
    h = int(0)
    while h < n:
        source = sources[env, hits[h]]
        target = target_of(bent(source, share, env, bends), share, width, height)
        add_all(nearest, sums, target, depth_at(source, share), image[env, source.pixel])
        h += 1
