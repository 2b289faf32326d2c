"""Computes the curvature of the pixels' paths from the motion of two gaps, and extrapolates the paths
into the gap that follows."""

import warp as wp

from nodes.interpolator.splat.warp_kernels import known_depth, same_surface

wp.set_module_options({"enable_backward": False})

NEARER = wp.constant(0.75)
"""Ratio of a point's depths at two keyframes below which they are taken to be of two surfaces."""

STEADY = wp.constant(0.75)
"""Change of velocity over the sum of both speeds from which on the motion is another surface's: a rotation by 97
degrees per gap has as much."""


@wp.kernel
def find_bends(
    # in
    ratio: wp.array(dtype=wp.float32),
    straight: wp.array(dtype=wp.int32),
    depth: wp.array3d(dtype=wp.float32),
    before: wp.array3d(dtype=wp.float32),
    motion: wp.array4d(dtype=wp.float32),
    earlier: wp.array4d(dtype=wp.float32),
    # out
    bends: wp.array2d(dtype=wp.vec2),
):
    """Computes bends of a keyframe's pixels [E, H W], px per gap^2: a path is p + u d + u (1 - u) bend, u back from
    here.

    depth, motion: of this keyframe; before, earlier: of the one before, at whose `motion` end the earlier motion is
    read, between four pixels of one surface. ratio: of the gap before to this one, [E]. straight: environments without.
    """
    env, y, x = wp.tid()
    width = depth.shape[2]
    bend = wp.vec2(0.0, 0.0)
    m = wp.vec2(motion[env, y, x, 0], motion[env, y, x, 1])
    u = float(x) + m[0]
    v = float(y) + m[1]
    z = known_depth(depth[env, y, x])
    inside = u >= 0.0 and v >= 0.0 and u <= float(width - 1) and v <= float(depth.shape[1] - 1)
    if straight[env] == 0 and inside:
        i = wp.min(wp.int32(u), width - 2)
        j = wp.min(wp.int32(v), depth.shape[1] - 2)
        nearest = known_depth(before[env, j, i])
        farthest = nearest
        total = wp.vec2(0.0, 0.0)
        for k in range(4):
            column = i + k % 2
            row = j + k // 2
            there = known_depth(before[env, row, column])
            nearest = wp.min(nearest, there)
            farthest = wp.max(farthest, there)
            weight = wp.abs(u - float(2 * i + 1 - column)) * wp.abs(v - float(2 * j + 1 - row))
            total += weight * wp.vec2(earlier[env, row, column, 0], earlier[env, row, column, 1])
        same = same_surface(farthest, nearest) and nearest * NEARER <= z and z * NEARER <= farthest
        before_that = total / ratio[env]
        change = before_that - m
        if same and wp.length(change) < STEADY * (wp.length(before_that) + wp.length(m)):
            bend = -change / (1.0 + ratio[env])
    bends[env, y * width + x] = bend


@wp.kernel
def extrapolate_paths(
    # in
    ratio: wp.array(dtype=wp.float32),
    straight: wp.array(dtype=wp.int32),
    motion: wp.array4d(dtype=wp.float32),
    # in and out
    bends: wp.array2d(dtype=wp.vec2),
    # out
    onward: wp.array4d(dtype=wp.float32),
):
    """Computes the bends of a keyframe in units of the gap after it, and minus the way that its pixels go in that
    gap."""
    env, y, x = wp.tid()
    pixel = y * motion.shape[2] + x
    bend = bends[env, pixel] / (ratio[env] * ratio[env])
    m = wp.vec2(motion[env, y, x, 0], motion[env, y, x, 1])
    if straight[env] != 0:
        bend = wp.vec2(0.0, 0.0)
    else:
        m = m / ratio[env] + (1.0 + ratio[env]) * bend
    bends[env, pixel] = bend
    onward[env, y, x, 0] = m[0]
    onward[env, y, x, 1] = m[1]
