"""Computes for how long shadows of boxes are on a point: by chords of their outlines, as a lamp sees them."""

import warp as wp

from nodes.interpolator.displacement_kernels import turn_of
from nodes.interpolator.refine.probing.box_kernels import Boxes

wp.set_module_options({"enable_backward": False})

LEVEL = wp.constant(1e-12)
"""Height of a side over the way, of the box's size, which counts as along it."""


@wp.func
def slope(along: wp.vec3d, above: wp.vec3d, axis: int):
    """Computes how far a side of a box goes along the way per metre of height over the way."""
    return along[axis] / above[axis]


@wp.func
def border_offset(along: wp.vec3d, above: wp.vec3d, order: wp.vec3i, depth: wp.float64):
    """Computes how far along the way the border of an outline is from its top, at a depth below that [m]; order: of the
    sides that make this border, from the top down."""
    left = depth
    way = wp.float64(0.0)
    for k in range(3):
        taken = wp.min(left, wp.float64(2.0) * above[order[k]])
        way += taken * slope(along, above, order[k])
        left -= taken
    return way


@wp.func
def chord(sides: wp.mat33d, ray: wp.vec3d, way: wp.vec3d, share: wp.float64):
    """Gives the length along a way, square to a ray, of the outline of a box as the ray sees it, at a share of its
    height over the way. The columns of `sides` are half of its sides.

    The outline has each side twice. From its top its two borders go down along the sides in the order of their slopes,
    each in the other's reverse.
    """
    ahead = wp.normalize(way)
    up = wp.normalize(wp.cross(ray, way))
    above = wp.transpose(sides) * up
    along = wp.transpose(sides) * ahead
    size = wp.sqrt(wp.ddot(sides, sides))
    for axis in range(3):
        if above[axis] < wp.float64(0.0):
            along[axis] = -along[axis]
        above[axis] = wp.max(wp.abs(above[axis]), wp.float64(LEVEL) * size)
    order = wp.vec3i(0, 1, 2)
    for n in range(3):
        k = n % 2
        if slope(along, above, order[k]) > slope(along, above, order[k + 1]):
            order = wp.where(k == 0, wp.vec3i(order[1], order[0], order[2]), wp.vec3i(order[0], order[2], order[1]))
    depth = wp.float64(2.0) * share * (above[0] + above[1] + above[2])
    back = wp.vec3i(order[2], order[1], order[0])
    return border_offset(along, above, back, depth) - border_offset(along, above, order, depth)


@wp.kernel
def find_box_shadow_times(
    # in
    boxes: Boxes,
    share: wp.array(dtype=wp.float64),
    lamps: wp.array3d(dtype=wp.vec3d),
    gone_by: wp.array3d(dtype=wp.vec3d),
    far: wp.array(dtype=int),
    rides: wp.array(dtype=int),
    first: wp.array(dtype=int),
    poses: wp.array3d(dtype=wp.transformd),
    # out
    times: wp.array4d(dtype=wp.float64),
    gone: wp.array4d(dtype=wp.float64),
):
    """Computes for how many instants the shadow of a box under a lamp, [lamps, n, E, J], is on a point at a share [J]
    of its height over its way, and the angle that it goes meanwhile, as the lamp sees it.

    A ray from a lamp to a point stays, and the box goes by it. lamps [lamps, n, E]: where they are, or towards where
    those are that are far. gone_by: how far each goes meanwhile where it goes by boxes that stand still, else 0. rides:
    on which mover a lamp is, if on any: what carries it does not go by it. first [n]: instants. poses [instants, E, M]
    of what moves.
    """
    l, n, env, j = wp.tid()
    mover = boxes.mover[j]
    before = poses[first[n], env, mover]
    centre = wp.transform_point(before, boxes.translation[j])
    way = wp.transform_point(poses[first[n] + 1, env, mover], boxes.translation[j]) - centre - gone_by[l, n, env]
    ray = lamps[l, n, env]
    if far[l] == 0:
        ray -= centre
    square = wp.dot(ray, ray)
    time = wp.float64(wp.inf)
    angle = wp.float64(0.0)
    if square > wp.float64(0.0) and rides[l] != mover:
        way -= (wp.dot(way, ray) / square) * ray
        length = wp.length(way)
        if length > wp.float64(0.0):
            angle = length / wp.sqrt(square)
            sides = turn_of(before) * boxes.rotation[j] * wp.diag(boxes.fine[j])
            time = chord(sides, ray, way, share[j]) / length
    times[l, n, env, j] = time
    gone[l, n, env, j] = angle
