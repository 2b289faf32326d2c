"""Computes how long moving things stay in the image that come and go between two probes."""

import warp as wp

from nodes.interpolator.displacement_kernels import turn_of

wp.set_module_options({"enable_backward": False})

PIECES = wp.constant(64)
"""Parts of the way from one instant to the next at which a thing is looked for that may pass the image on it."""
QUICK = wp.constant(0.25)
"""Part of its size by which a thing about the near plane moves in a gap, at least, if it is to count."""


@wp.struct
class Boxes:
    """Holds the boxes of things: which of the bodies that move they are on [J], where on it, and half their sides.

    fine: half of how wide their parts and holes are along these sides, for `find_shortest_shadows`.
    """

    mover: wp.array(dtype=int)
    rotation: wp.array(dtype=wp.mat33d)
    translation: wp.array(dtype=wp.vec3d)
    half: wp.array(dtype=wp.vec3d)
    fine: wp.array(dtype=wp.vec3d)


@wp.func
def reach(normal: wp.vec3d, centre: wp.vec3d, axes: wp.mat33d, half: wp.vec3d):
    """Gives how far a box reaches over a plane through the origin, at most."""
    along = wp.transpose(axes) * normal
    return wp.dot(normal, centre) + wp.abs(along[0]) * half[0] + wp.abs(along[1]) * half[1] + wp.abs(along[2]) * half[2]


@wp.struct
class ImageReach:
    """Holds how far into the image a box reaches, as a part of how far ahead it does, and beyond which of its sides it
    is: a bit for each, 0 inside."""

    inside: wp.float64
    ahead: wp.float64
    beyond: int


@wp.func
def image_reach(centre: wp.vec3d, axes: wp.mat33d, half: wp.vec3d, near: wp.float64, sides: wp.vec4d):
    """Finds how far a box reaches into the image. sides: as of find_appearances."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    way = ImageReach()
    way.inside = -one
    ahead = reach(wp.vec3d(zero, zero, one), centre, axes, half)
    way.ahead = wp.max(ahead, near)
    left = reach(wp.vec3d(one, zero, -sides[0]), centre, axes, half)
    right = reach(wp.vec3d(-one, zero, sides[1]), centre, axes, half)
    top = reach(wp.vec3d(zero, one, -sides[2]), centre, axes, half)
    bottom = reach(wp.vec3d(zero, -one, sides[3]), centre, axes, half)
    if ahead > near:
        way.inside = wp.min(wp.min(left, right), wp.min(top, bottom)) / ahead
    else:
        way.beyond = 1
    way.beyond += wp.where(left < zero, 2, 0) + wp.where(right < zero, 4, 0)
    way.beyond += wp.where(top < zero, 8, 0) + wp.where(bottom < zero, 16, 0)
    return way


@wp.kernel
def find_appearances(
    # in
    boxes: Boxes,
    camera: int,
    near: wp.float64,
    sides: wp.vec4d,
    deep: wp.float64,
    eye: wp.array(dtype=wp.transformd),
    poses: wp.array3d(dtype=wp.transformd),
    # out
    shortest: wp.array(dtype=int),
    passing: wp.array(dtype=int),
):
    """Finds the shortest visit of a box to the image, in instants: one that begins and ends within the gap, and in
    which it comes further in than `deep`; 0 for one that does so between two instants alone. passing [E]: 1 where one
    is on both sides of the near plane for a while, which hides part of it from one instant to the next.

    camera: its place among what moves, -1 where it stands at eye [E]. sides: least and greatest x / z, then y / z, of
    the image; deep: in these. poses [n, E, M]: at the instants of a gap, one after the other.
    """
    env, j = wp.tid()
    half = boxes.half[j]
    before = wp.bool(True)
    stay = wp.int32(0)
    far_in = wp.float64(0.0)
    zero = wp.float64(0.0)
    last = ImageReach()
    last.inside = -wp.float64(1.0)
    last_centre = wp.vec3d()
    last_axes = wp.mat33d()
    for n in range(poses.shape[0]):
        at = eye[env]
        if camera >= 0:
            at = poses[n, env, camera]
        back = wp.transpose(turn_of(at))
        pose = poses[n, env, boxes.mover[j]]
        turn = back * turn_of(pose)
        centre = turn * boxes.translation[j] + back * (
            wp.transform_get_translation(pose) - wp.transform_get_translation(at)
        )
        axes = turn * boxes.rotation[j]
        way = image_reach(centre, axes, half, near, sides)
        if way.inside >= zero:
            if not before:
                stay += 1
                far_in = wp.max(far_in, way.inside)
        else:
            if stay > 0 and far_in > deep:
                wp.atomic_min(shortest, env, stay)
            before = wp.bool(False)
            stay = wp.int32(0)
            far_in = zero
        gone = zero
        if n > 0:
            gone = wp.length(centre - last_centre) + wp.length((axes - last_axes) * half)
        shows = way.inside >= zero or last.inside >= zero
        if shows and gone * wp.float64(poses.shape[0]) > wp.float64(QUICK) * wp.length(half):
            cuts = -reach(wp.vec3d(zero, zero, -wp.float64(1.0)), centre, axes, half) < near
            if cuts or ((way.beyond ^ last.beyond) & 1) == 1:
                passing[env] = 1
        # What stays beyond one side all along does not come in, and what hardly moves not far.
        most_in = wp.max(last.inside, way.inside)
        if n > 0 and most_in < deep and (way.beyond & last.beyond) == 0:
            if most_in + gone / wp.min(last.ahead, way.ahead) > deep:
                for k in range(1, PIECES):
                    g = wp.float64(k) / wp.float64(PIECES)
                    between = image_reach(
                        last_centre + g * (centre - last_centre), last_axes + g * (axes - last_axes), half, near, sides
                    )
                    if between.inside > deep:
                        wp.atomic_min(shortest, env, 0)
        last = way
        last_centre = centre
        last_axes = axes


@wp.func
def width_over(fine: wp.vec3d, along: wp.vec3d, length: wp.float64):
    """Gives half the width [m] of a box of half sides `fine` along a way, in its own frame, of a length: how far it
    reaches along it or, if that is less, what of the way lies in it, as of a long wire that goes aslant.

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
            width = width_over(fine, wp.transpose(axes) * way, length)
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
