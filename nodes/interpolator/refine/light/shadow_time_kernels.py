"""Computes for how many instants shadows of boxes that move are on a point: by their width over their speed, and by the
time between two turns of what goes to and fro."""

import warp as wp

from nodes.interpolator.displacement_kernels import turn_of
from nodes.interpolator.refine.probing.box_kernels import Boxes

wp.set_module_options({"enable_backward": False})


@wp.func
def half_width_along(fine: wp.vec3d, along: wp.vec3d, length: wp.float64):
    """Computes half the width [m] of a box along a way: how far it reaches along it or, if that is less, half the part
    of the way that lies in it, as of a long wire that goes aslant.

    fine: half the sides of the box [m]. along: the way in the frame of the box [m], of this length.

    A plate counts there as thick as it is wide: where a lamp shines along it `BoxShadows` tells.
    """
    thick = fine[0] + fine[1] + fine[2] - wp.min(fine) - wp.max(fine)
    width = (wp.abs(along[0]) * fine[0] + wp.abs(along[1]) * fine[1] + wp.abs(along[2]) * fine[2]) / length
    for axis in range(3):
        if thick > wp.float64(0.0) and wp.abs(along[axis]) > wp.float64(0.0):
            width = wp.min(width, wp.max(fine[axis], thick) * length / wp.abs(along[axis]))
    return width


@wp.kernel
def find_shortest_shadows(
    # in
    boxes: Boxes,
    shine: wp.array(dtype=wp.float64),
    first: wp.array(dtype=int),
    poses: wp.array3d(dtype=wp.transformd),
    # out
    briefest: wp.array3d(dtype=wp.float64),
):
    """Computes for how many instants the shadow of a box [n, E, J], or of a part or a hole in it, is on a point at
    least: its width along the way of the middle of the box or of a side, over that way from one instant to the next.

    shine [E]: way of the lamps meanwhile [m]. first [n]: instants. poses [instants, E, M] of what moves.
    """
    n, env, j = wp.tid()
    before = poses[first[n], env, boxes.mover[j]]
    after = poses[first[n] + 1, env, boxes.mover[j]]
    turn = boxes.rotation[j]
    axes = turn_of(before) * turn
    half = boxes.half[j]
    fine = boxes.fine[j]
    least = wp.float64(wp.inf)
    for p in range(7):
        at = boxes.translation[j]
        if p > 0:
            axis = (p - 1) % 3
            at += wp.where(p > 3, -half[axis], half[axis]) * wp.vec3d(turn[0, axis], turn[1, axis], turn[2, axis])
        way = wp.transform_point(after, at) - wp.transform_point(before, at)
        length = wp.length(way)
        if length > wp.float64(0.0):
            width = half_width_along(fine, wp.transpose(axes) * way, length)
            if width > wp.float64(0.0):
                least = wp.min(least, wp.float64(2.0) * width / (length + shine[env]))
    briefest[n, env, j] = least


@wp.kernel
def find_shortest_oscillations(
    # in
    boxes: Boxes,
    step: int,
    near: wp.float64,
    eye: wp.array(dtype=wp.transformd),
    poses: wp.array3d(dtype=wp.transformd),
    # out
    briefest: wp.array2d(dtype=wp.float64),
):
    """Computes how many instants [E, J] pass between two turns of a box that goes to and fro, at least.

    Its middle and a corner are looked at at every step-th instant. near: part of the distance from the camera, eye [E],
    that it goes from one turn to the next, or none counts. poses: as of `find_shortest_shadows`.
    """
    env, j = wp.tid()
    shortest = wp.float64(wp.inf)
    zero = wp.vec3d()
    for p in range(2):
        at = boxes.translation[j]
        if p == 1:
            at += boxes.rotation[j] * boxes.half[j]
        last = wp.transform_point(poses[0, env, boxes.mover[j]], at)
        least = near * wp.length(last - wp.transform_get_translation(eye[env]))
        begun = last
        way = zero
        turn = wp.int32(-1)
        n = step
        while n < poses.shape[0]:
            now = wp.transform_point(poses[n, env, boxes.mover[j]], at)
            if wp.dot(now - last, way) < wp.float64(0.0):
                if wp.length(last - begun) > least:
                    if turn >= 0:
                        shortest = wp.min(shortest, wp.float64(n - step - turn))
                    turn = n - step
                begun = last
            way = now - last
            last = now
            n += step
    briefest[env, j] = shortest
