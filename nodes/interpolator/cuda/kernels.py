"""Kernels of the warp on a GPU: one thread per source and sub-frame, and sums that do not depend on their order.

Depths and brightest values meet by atomic minimum and maximum, sums in whole numbers: a weight has 24 bits, a value 28
bits relative to the brightest one of its target, which leaves room for 2^11 whole pixels on one target; a target with
more shows the brightest.
"""

import warp as wp

from nodes.interpolator.kernels import (
    EMPTY,
    SAME_SURFACE,
    SUBPIXEL,
    Source,
    background,
    displaced_depth,
    known_depth,
    padded,
    target_of,
)

wp.set_module_options({"enable_backward": False})

SCALE = wp.constant(wp.float64(2.0**28))
ROOM = wp.constant(wp.int64(2**35))
LOST = wp.constant(2.0e38)
"""dz of a source that has no place: its motion is not finite."""


@wp.kernel
def locate(
    # in
    sign: wp.float32,
    held: wp.array(dtype=wp.int32),
    depth: wp.array3d(dtype=wp.float32),
    other_depth: wp.array3d(dtype=wp.float32),
    motion: wp.array4d(dtype=wp.float32),
    # out
    sources: wp.array2d(dtype=Source),
    lost: wp.array(dtype=wp.int32),
):
    """Every pixel of a keyframe as a source; sign: +1 for B (it goes back along its motion), -1 for A."""
    env, y, x = wp.tid()
    dx = sign * motion[env, y, x, 0]
    dy = sign * motion[env, y, x, 1]
    own = known_depth(depth[env, y, x])
    if held[env] != 0:
        dx = float(0.0)
        dy = float(0.0)
    source = Source()
    grid = float(SUBPIXEL)
    source.x = grid * float(x)
    source.y = grid * float(y)
    source.dx = grid * dx
    source.dy = grid * dy
    source.z = own
    source.pixel = y * depth.shape[2] + x
    if wp.abs(dx) < 1.0e6 and wp.abs(dy) < 1.0e6:
        there = displaced_depth(other_depth, env, float(x) + dx, float(y) + dy, own)
        source.dz = wp.where(held[env] != 0, 0.0, there - own)
    else:
        source.dz = LOST
        if not (wp.isfinite(dx) and wp.isfinite(dy)):
            wp.atomic_add(lost, 0, 1)
    sources[env, source.pixel] = source


@wp.func
def fraction(sub: int, upsampling: int, backward: int):
    """How far a source of this sub-frame has moved: 1 - f for B, f for A, f = i / K."""
    i = sub % (upsampling - 1) + 1
    if backward != 0:
        i = upsampling - i
    return float(i) / float(upsampling)


@wp.kernel
def lower_all(
    # in
    first: int,
    upsampling: int,
    backward: int,
    width: int,
    height: int,
    sources: wp.array2d(dtype=Source),
    # out
    nearest: wp.array2d(dtype=wp.float32),
):
    """The depth of the nearest source of every target."""
    row, pixel = wp.tid()
    sub = first + row
    source = sources[sub // (upsampling - 1), pixel]
    a = fraction(sub, upsampling, backward)
    target = target_of(source, a, width, height)
    if target.at >= 0 and source.dz < LOST:
        z = source.z + a * source.dz
        wp.atomic_min(nearest, row, target.at, z)
        if target.right != 0:
            wp.atomic_min(nearest, row, target.at + target.right, z)
        if target.down != 0:
            wp.atomic_min(nearest, row, target.at + target.down, z)
        if target.right != 0 and target.down != 0:
            wp.atomic_min(nearest, row, target.at + target.right + target.down, z)


@wp.func
def brighten(
    row: int, at: int, z: wp.float32, weight: int, value: wp.float32, slot: int,
    nearest: wp.array2d(dtype=wp.float32), peaks: wp.array3d(dtype=wp.float32),
):  # fmt: skip
    if weight > 0 and z * SAME_SURFACE <= nearest[row, at]:
        wp.atomic_max(peaks, row, at, slot, value)


@wp.kernel
def peak_all(
    # in
    first: int,
    upsampling: int,
    backward: int,
    width: int,
    height: int,
    sources: wp.array2d(dtype=Source),
    image: wp.array3d(dtype=wp.float32),
    nearest: wp.array2d(dtype=wp.float32),
    # out
    peaks: wp.array3d(dtype=wp.float32),
):
    """The largest absolute value among the sources that a target averages; infinite when one is not finite."""
    row, pixel, c = wp.tid()
    sub = first + row
    env = sub // (upsampling - 1)
    source = sources[env, pixel]
    a = fraction(sub, upsampling, backward)
    target = target_of(source, a, width, height)
    if target.at >= 0 and source.dz < LOST:
        z = source.z + a * source.dz
        value = wp.abs(image[env, pixel, c])
        if not wp.isfinite(value):
            value = float(wp.inf)
        gx = SUBPIXEL - target.fx
        gy = SUBPIXEL - target.fy
        at = target.at
        brighten(row, at, z, gx * gy, value, c, nearest, peaks)
        brighten(row, at + target.right, z, target.fx * gy, value, c, nearest, peaks)
        brighten(row, at + target.down, z, gx * target.fy, value, c, nearest, peaks)
        brighten(row, at + target.right + target.down, z, target.fx * target.fy, value, c, nearest, peaks)


@wp.func
def add(
    row: int, at: int, z: wp.float32, weight: int, value: wp.float32, c: int,
    nearest: wp.array2d(dtype=wp.float32), peaks: wp.array3d(dtype=wp.float32),
    sums: wp.array3d(dtype=wp.int64), weights: wp.array2d(dtype=wp.int64),
):  # fmt: skip
    if weight > 0 and z * SAME_SURFACE <= nearest[row, at]:
        peak = peaks[row, at, c]
        if peak > 0.0 and wp.isfinite(peak):
            share = wp.rint(wp.float64(value) / wp.float64(peak) * SCALE)
            wp.atomic_add(sums, row, at, c, wp.int64(weight) * wp.int64(share))
        if c == 0:
            wp.atomic_add(weights, row, at, wp.int64(weight))


@wp.kernel
def add_all(
    # in
    first: int,
    upsampling: int,
    backward: int,
    width: int,
    height: int,
    sources: wp.array2d(dtype=Source),
    image: wp.array3d(dtype=wp.float32),
    nearest: wp.array2d(dtype=wp.float32),
    peaks: wp.array3d(dtype=wp.float32),
    # out
    sums: wp.array3d(dtype=wp.int64),
    weights: wp.array2d(dtype=wp.int64),
):
    """Bilinear sums of the sources within 1 % of the nearest."""
    row, pixel, c = wp.tid()
    sub = first + row
    env = sub // (upsampling - 1)
    source = sources[env, pixel]
    a = fraction(sub, upsampling, backward)
    target = target_of(source, a, width, height)
    if target.at >= 0 and source.dz < LOST:
        z = source.z + a * source.dz
        value = image[env, pixel, c]
        gx = SUBPIXEL - target.fx
        gy = SUBPIXEL - target.fy
        at = target.at
        add(row, at, z, gx * gy, value, c, nearest, peaks, sums, weights)
        add(row, at + target.right, z, target.fx * gy, value, c, nearest, peaks, sums, weights)
        add(row, at + target.down, z, gx * target.fy, value, c, nearest, peaks, sums, weights)
        add(row, at + target.right + target.down, z, target.fx * target.fy, value, c, nearest, peaks, sums, weights)


@wp.kernel
def resolve(
    # in
    first: int,
    upsampling: int,
    width: int,
    backward: int,
    # in and out
    nearest: wp.array2d(dtype=wp.float32),
    nearest_a: wp.array2d(dtype=wp.float32),
    peaks: wp.array3d(dtype=wp.float32),
    sums: wp.array3d(dtype=wp.int64),
    weights: wp.array2d(dtype=wp.int64),
    # out
    frames: wp.array3d(dtype=wp.float32),
):
    """Sums to pixels. After B the holes are opened for A (EMPTY) and all else closed (0); after A unknown pixels get
    depth -1 and the others the depth of what they show."""
    row, pixel = wp.tid()
    sub = first + row
    at = padded(pixel, width)
    frame = sub // (upsampling - 1) * upsampling + sub % (upsampling - 1)
    total = weights[row, at]
    if total > wp.int64(0):
        for c in range(frames.shape[2]):
            peak = wp.float64(peaks[row, at, c])
            share = wp.float64(1.0)
            if total < ROOM:
                share = wp.float64(sums[row, at, c]) / wp.float64(total) / SCALE
            value = wp.float32(peak * share)
            if not wp.isfinite(peak):
                value = float(wp.nan)
            frames[frame, pixel, c] = value
            peaks[row, at, c] = 0.0
            sums[row, at, c] = wp.int64(0)
        weights[row, at] = wp.int64(0)
    if backward != 0:
        nearest_a[row, at] = wp.where(total > wp.int64(0), 0.0, EMPTY)
    elif nearest_a[row, at] > 0.0:
        nearest[row, at] = wp.where(total > wp.int64(0), nearest_a[row, at], -1.0)


@wp.kernel
def fill(
    # in
    first: int,
    upsampling: int,
    width: int,
    height: int,
    margin: int,
    nearest: wp.array2d(dtype=wp.float32),
    image: wp.array3d(dtype=wp.float32),
    # out
    frames: wp.array3d(dtype=wp.float32),
    filled: wp.array(dtype=wp.int32),
):
    """Pixels seen in neither keyframe take their nearest background; where there is none, B's value."""
    row, pixel = wp.tid()
    if nearest[row, padded(pixel, width)] < 0.0:
        sub = first + row
        frame = sub // (upsampling - 1) * upsampling + sub % (upsampling - 1)
        x = pixel % width
        y = pixel // width
        if wp.min(wp.min(x, width - 1 - x), wp.min(y, height - 1 - y)) >= margin:
            wp.atomic_add(filled, 0, 1)
        known = background(nearest[row], pixel, width, height)
        for c in range(frames.shape[2]):
            if known >= 0:
                frames[frame, pixel, c] = frames[frame, known, c]
            else:
                frames[frame, pixel, c] = image[sub // (upsampling - 1), pixel, c]
