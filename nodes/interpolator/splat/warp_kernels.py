# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""What the warp is made of on any device: sources, their targets, the background behind an unknown pixel; luminance."""

from typing import Any

import warp as wp

from nodes.renderer.shading.radiance_kernels import luminance as luminance_of_colour

wp.set_module_options({"enable_backward": False})

SUBPIXEL = wp.constant(4096)
"""Target positions lie on a grid of 1/4096 px: weights are exact products of two 12-bit numbers, and motion that is a
whole number of pixels but for rounding stays so."""
SKY = wp.constant(1.0e30)
"""Depth [m] of the sky and of anything without a valid depth, finite so that it can be interpolated."""
EMPTY = wp.constant(3.0e38)
"""Depth of a target that nothing has reached."""
SAME_SURFACE = wp.constant(1.0 / 1.01)
"""Sources at most 1 % behind the nearest one belong to the same surface and are averaged."""


@wp.struct
class Source:
    """A keyframe pixel that moves. At fraction a of the way to the other keyframe it is at (x, y) + a (dx, dy), in
    1/4096 px, at depth z + a dz."""

    x: wp.float32
    y: wp.float32
    dx: wp.float32
    dy: wp.float32
    z: wp.float32
    dz: wp.float32
    pixel: wp.int32


@wp.func
def known_depth(depth: wp.float32):
    """Depth with sky, NaN and nonsense mapped to SKY."""
    return wp.where(depth > 0.0 and depth < SKY, depth, SKY)


@wp.func
def corner(position: wp.float32):
    """Nearest grid position as a whole number of 1/4096 px; position > -4096 so that truncation is floor."""
    return wp.int32(position + float(SUBPIXEL) + 0.5) - SUBPIXEL


@wp.kernel
def luminance(
    # in
    radiance: wp.array2d(dtype=Any),
    # out
    image: wp.array(dtype=wp.float32),
):
    """Equation (3) of pixels [N, 3]; of float16 it is rounded to that, as it is where the renderer gives it."""
    i = wp.tid()
    red = radiance[i, 0]
    value = luminance_of_colour(wp.vec3(wp.float32(red), wp.float32(radiance[i, 1]), wp.float32(radiance[i, 2])))
    image[i] = wp.float32(type(red)(value))


@wp.kernel
def negated(
    # in
    values: wp.array(dtype=wp.float32),
    # out
    result: wp.array(dtype=wp.float32),
):
    i = wp.tid()
    result[i] = -values[i]


@wp.kernel
def mean(
    # in
    samples: int,
    channels: int,
    fine: wp.array3d(dtype=wp.float32),
    # out
    frames: wp.array3d(dtype=wp.float32),
):
    """Frames [R, h, w C] of C channels: means of samples x samples pixels of fine [R, samples h, samples w C]."""
    row, y = wp.tid()
    x = wp.int32(0)
    while x < frames.shape[2]:
        first = x // channels * channels * samples + x % channels
        total = wp.float32(0.0)
        for j in range(samples):
            for i in range(samples):
                total += fine[row, y * samples + j, first + i * channels]
        frames[row, y, x] = total / float(samples * samples)
        x += 1


@wp.func
def displaced_depth(depth: wp.array3d(dtype=wp.float32), env: int, x: wp.float32, y: wp.float32, own: wp.float32):
    """Depth of the nearest pixel to (x, y) in the other keyframe; `own` where that is outside or sky."""
    column = wp.floor(x + 0.5)
    row = wp.floor(y + 0.5)
    if own < SKY and column >= 0.0 and row >= 0.0:
        if column < float(depth.shape[2]) and row < float(depth.shape[1]):
            there = known_depth(depth[env, wp.int32(row), wp.int32(column)])
            return wp.where(there < SKY, there, own)
    return own


@wp.struct
class Target:
    """Where a source lands: the first of its pixels on the padded grid (-1: outside), the steps to the others, and the
    fractions in 1/4096 px. A step is 0 where the fraction is 0, so that only pixels with weight are touched."""

    at: wp.int32
    right: wp.int32
    down: wp.int32
    fx: wp.int32
    fy: wp.int32


@wp.func
def bent(source: Source, a: wp.float32, env: int, bends: wp.array2d(dtype=wp.vec2)):
    """The source whose straight path is at a where this one's is, p + a d + a (1 - a) bend.

    bends: px [E, H W], or of no elements where all paths are straight.
    """
    shifted = source
    if bends.shape[1] > 0:
        bend = float(SUBPIXEL) * a * (1.0 - a) * bends[env, source.pixel]
        shifted.x += bend[0]
        shifted.y += bend[1]
    return shifted


@wp.func
def target_of(source: Source, a: wp.float32, width: int, height: int):
    target = Target()
    target.at = -1
    x = source.x + a * source.dx
    y = source.y + a * source.dy
    grid = float(SUBPIXEL)
    if x > -grid and y > -grid and x < grid * float(width) and y < grid * float(height):
        ix = corner(x)
        iy = corner(y)
        target.at = ((iy >> 12) + 1) * (width + 2) + (ix >> 12) + 1
        target.fx = ix & 4095
        target.fy = iy & 4095
        target.right = wp.min(target.fx, 1)
        target.down = wp.min(target.fy, 1) * (width + 2)
    return target


@wp.func
def padded(pixel: int, width: int):
    """Index on the padded grid, which has one more pixel on every side."""
    return (pixel // width + 1) * (width + 2) + pixel % width + 1


@wp.func
def steps_to_known(nearest: wp.array(dtype=wp.float32), at: int, stride: int, limit: int):
    """How many strides away the next known pixel is; 0 if there is none within the limit."""
    step = int(1)
    while step <= limit:
        if nearest[at + step * stride] >= 0.0:
            return step
        step += 1
    return 0


@wp.func
def background(nearest: wp.array(dtype=wp.float32), pixel: int, width: int, height: int):
    """The pixel that a pixel seen in neither keyframe takes its value from, or -1.

    Of the next known pixels left and right, or above and below where the row has none, the farther surface, for it is
    the background that gets uncovered; of two on the same surface the closer one.
    """
    at = padded(pixel, width)
    x = pixel % width
    y = pixel // width
    stride = int(1)
    step = int(1)
    before = steps_to_known(nearest, at, -1, x)
    after = steps_to_known(nearest, at, 1, width - 1 - x)
    if before == 0 and after == 0:
        stride = width + 2
        step = width
        before = steps_to_known(nearest, at, -stride, y)
        after = steps_to_known(nearest, at, stride, height - 1 - y)
    if before == 0 and after == 0:
        return -1
    take_before = after == 0
    if before > 0 and after > 0:
        z_before = nearest[at - before * stride]
        z_after = nearest[at + after * stride]
        take_before = z_before > z_after
        if z_before * SAME_SURFACE <= z_after and z_after * SAME_SURFACE <= z_before:
            take_before = before <= after
    return pixel + step * wp.where(take_before, -before, after)
