# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Computes the equations of the warp, (5) to (7), once for every device: where a source is at a fraction of the gap,
which pixels it lands on with which weights, which sources are in front, and what fills a pixel that no source reaches.

The kernels of a device decide only in which order sources are gone through and how sums are kept.
"""

import warp as wp

from nodes.renderer.raster.lens.displacement_kernels import FAR_AWAY

wp.set_module_options({"enable_backward": False})

SUBPIXEL_BITS = wp.constant(12)
SUBPIXEL = wp.constant(1 << SUBPIXEL_BITS)
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
    """Holds a keyframe pixel that moves: once it has gone a share s of its way to the other keyframe it is at
    (x, y) + s (dx, dy), in 1/4096 px, at depth z + s dz [m]."""

    x: wp.float32
    y: wp.float32
    dx: wp.float32
    dy: wp.float32
    z: wp.float32
    dz: wp.float32
    pixel: wp.int32


@wp.func
def known_depth(depth: wp.float32):
    """Maps the depth of the sky, NaN and what is no depth to SKY."""
    return wp.where(depth > 0.0 and depth < SKY, depth, SKY)


@wp.func
def grid_position(position: wp.float32):
    """Rounds a position to a whole number of 1/4096 px; position > -4096, so that truncation is floor."""
    return wp.int32(position + float(SUBPIXEL) + 0.5) - SUBPIXEL


@wp.func
def displaced_depth(depth: wp.array3d(dtype=wp.float32), env: int, x: wp.float32, y: wp.float32, own: wp.float32):
    """Reads the other keyframe's depth at the pixel nearest to (x, y); gives `own` where that is outside or sky."""
    column = wp.floor(x + 0.5)
    row = wp.floor(y + 0.5)
    if own < SKY and column >= 0.0 and row >= 0.0:
        if column < float(depth.shape[2]) and row < float(depth.shape[1]):
            there = known_depth(depth[env, wp.int32(row), wp.int32(column)])
            return wp.where(there < SKY, there, own)
    return own


@wp.func
def stays_put(hold: int, straight: bool, dx: wp.float32, dy: wp.float32, z: wp.float32, other_z: wp.float32):
    """Tells whether a pixel shows the same all through the gap: no motion, no change of depth, or held on purpose.

    dx, dy: motion [px]; z, other_z: depths [m] of this pixel in both keyframes.
    """
    return hold != 0 or (straight and dx == 0.0 and dy == 0.0 and z == other_z)


@wp.func
def source_of(
    other_depth: wp.array3d(dtype=wp.float32), env: int, x: int, y: int, pixel: int,
    dx: wp.float32, dy: wp.float32, own: wp.float32,
):  # fmt: skip
    """Makes a source of the pixel (x, y), which moves by (dx, dy) px to the other keyframe; own: its known depth."""
    there = displaced_depth(other_depth, env, float(x) + dx, float(y) + dy, own)
    grid = float(SUBPIXEL)
    source = Source()
    source.x = grid * float(x)
    source.y = grid * float(y)
    source.dx = grid * dx
    source.dy = grid * dy
    source.z = own
    source.dz = there - own
    source.pixel = pixel
    return source


@wp.func
def can_land(dx: wp.float32, dy: wp.float32):
    """Tells whether a displacement [px] is one that a source can have: finite, and not FAR_AWAY."""
    return wp.abs(dx) < FAR_AWAY and wp.abs(dy) < FAR_AWAY


@wp.func
def depth_at(source: Source, share: wp.float32):
    """Computes the depth of a source that has gone a share of its way, between its own and that of where it goes."""
    return source.z + share * source.dz


@wp.func
def share_gone(i: int, upsampling: int, backward: int):
    """Computes the share of their way that sources have gone at sub-frame i of K: f = i / K for A's, 1 - f for B's,
    which go backward."""
    if backward != 0:
        return float(upsampling - i) / float(upsampling)
    return float(i) / float(upsampling)


@wp.func
def same_surface(z: wp.float32, nearest: wp.float32):
    """Tells whether a depth belongs to the surface that is nearest: it is at most 1 % behind."""
    return z * SAME_SURFACE <= nearest


@wp.func
def bilinear(fx: int, fy: int, right: int, down: int):
    """Computes the bilinear weight, in units of 2^-24, of one of the four pixels about a source at the fractions
    (fx, fy) / 4096 px; right, down: 1 for the pixels on that side, else 0."""
    x = fx
    y = fy
    if right == 0:
        x = SUBPIXEL - x
    if down == 0:
        y = SUBPIXEL - y
    return x * y


@wp.func
def counts_as_filled(pixel: int, width: int, height: int, margin: int):
    """Tells whether a pixel lies inside the margin, where a guess is counted."""
    x = pixel % width
    y = pixel // width
    return wp.min(wp.min(x, width - 1 - x), wp.min(y, height - 1 - y)) >= margin


@wp.struct
class Target:
    """Holds where a source lands: the first of its pixels on the padded grid (-1: outside), the steps to the others,
    and the fractions in 1/4096 px. A step is 0 where the fraction is 0, so that only pixels with weight are touched."""

    at: wp.int32
    right: wp.int32
    down: wp.int32
    fx: wp.int32
    fy: wp.int32


@wp.func
def bent(source: Source, share: wp.float32, env: int, bends: wp.array2d(dtype=wp.vec2)):
    """Shifts a source so that its straight path p + s d is, at the share s, where the bent one is: p + s d +
    s (1 - s) bend.

    bends: px [E, H W], or of no elements where all paths are straight.
    """
    shifted = source
    if bends.shape[1] > 0:
        bend = float(SUBPIXEL) * share * (1.0 - share) * bends[env, source.pixel]
        shifted.x += bend[0]
        shifted.y += bend[1]
    return shifted


@wp.func
def target_of(source: Source, share: wp.float32, width: int, height: int):
    """Finds the pixels that a source lands on once it has gone a share of its way, equations (5) and (6)."""
    target = Target()
    target.at = -1
    x = source.x + share * source.dx
    y = source.y + share * source.dy
    grid = float(SUBPIXEL)
    if x > -grid and y > -grid and x < grid * float(width) and y < grid * float(height):
        ix = grid_position(x)
        iy = grid_position(y)
        target.at = ((iy >> SUBPIXEL_BITS) + 1) * (width + 2) + (ix >> SUBPIXEL_BITS) + 1
        target.fx = ix & (SUBPIXEL - 1)
        target.fy = iy & (SUBPIXEL - 1)
        target.right = wp.min(target.fx, 1)
        target.down = wp.min(target.fy, 1) * (width + 2)
    return target


@wp.func
def padded(pixel: int, width: int):
    """Computes a pixel's index on the padded grid, which has one more pixel on every side."""
    return (pixel // width + 1) * (width + 2) + pixel % width + 1


@wp.func
def steps_to_known(nearest: wp.array(dtype=wp.float32), at: int, stride: int, limit: int):
    """Counts the strides to the next pixel that is known; 0 if there is none within the limit."""
    step = int(1)
    while step <= limit:
        if nearest[at + step * stride] >= 0.0:
            return step
        step += 1
    return 0


@wp.func
def background(nearest: wp.array(dtype=wp.float32), pixel: int, width: int, height: int):
    """Finds the pixel from which one that neither keyframe saw takes its value; -1 if there is none.

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
        if same_surface(z_before, z_after) and same_surface(z_after, z_before):
            take_before = before <= after
    return pixel + step * wp.where(take_before, -before, after)
