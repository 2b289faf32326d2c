# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Makes sources of a keyframe's pixels on a CPU, for a gap: of those that move, with a box around their paths."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.splat.warp_kernels import EMPTY, Source, can_land, known_depth, source_of, stays_put

wp.set_module_options({"enable_backward": False})


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
