"""Follows boxes, or the camera past them, through a gap, and finds what of them is seen for a short time."""

import warp as wp

from nodes.interpolator.displacement_kernels import turn_of
from nodes.interpolator.refine.probing.box_kernels import Boxes, reach
from nodes.interpolator.refine.probing.narrow_kernels import add_missed, narrow_way

wp.set_module_options({"enable_backward": False})

PIECES = wp.constant(64)
"""Parts of the way from one instant to the next at which a thing is looked for that may pass the image on it."""
QUICK = wp.constant(0.25)
"""Part of its size by which a thing about the near plane moves in a gap, at least, if it is to count."""
SWEPT = wp.constant(14.0)
"""Instants within which what passes the near plane is shown too seldom, if it goes by its own size in them: as it comes
near, all of it sweeps over every pixel."""
PASSES = wp.constant(1)
TOO_FAST = wp.constant(2)


@wp.struct
class ImageReach:
    """Holds how far into the image a box reaches, as a part of how far ahead it does, and beyond which of its sides it
    is: a bit for each, 0 inside."""

    inside: wp.float64
    ahead: wp.float64
    beyond: int


@wp.func
def image_reach(centre: wp.vec3d, axes: wp.mat33d, half: wp.vec3d, near: wp.float64, sides: wp.vec4d):
    """Finds how far a box reaches into the image. sides: as of follow_boxes."""
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


@wp.struct
class BoxPlace:
    """Holds where a box is before the camera: its centre [m], its axes, and how far it reaches into the image."""

    centre: wp.vec3d
    axes: wp.mat33d
    image: ImageReach


@wp.func
def box_place(centre: wp.vec3d, axes: wp.mat33d, half: wp.vec3d, near: wp.float64, sides: wp.vec4d):
    """Makes the BoxPlace of a box in the camera's frame."""
    place = BoxPlace()
    place.centre = centre
    place.axes = axes
    place.image = image_reach(centre, axes, half, near, sides)
    return place


@wp.func
def place_of(boxes: Boxes, j: int, pose: wp.transformd, eye: wp.transformd, near: wp.float64, sides: wp.vec4d):
    """Finds the BoxPlace of box j, whose body is at `pose`, before a camera at `eye`."""
    back = wp.transpose(turn_of(eye))
    turn = back * turn_of(pose)
    centre = turn * boxes.translation[j] + back * (
        wp.transform_get_translation(pose) - wp.transform_get_translation(eye)
    )
    return box_place(centre, turn * boxes.rotation[j], boxes.half[j], near, sides)


@wp.func
def passes_near_plane(here: BoxPlace, last: BoxPlace, half: wp.vec3d, gone: wp.float64, near: wp.float64):
    """Tells whether a box, of which something is in the image, cuts the near plane or has gone through it since the
    last instant: PASSES or TOO_FAST, else 0. gone: how far it has moved since [m]."""
    zero = wp.float64(0.0)
    shows = here.image.inside >= zero or last.image.inside >= zero
    if not shows:
        return 0
    cuts = -reach(wp.vec3d(zero, zero, -wp.float64(1.0)), here.centre, here.axes, half) < near
    if not (cuts or ((here.image.beyond ^ last.image.beyond) & 1) == 1):
        return 0
    size = wp.float64(2.0) * wp.max(wp.max(half[0], half[1]), half[2])
    return wp.where(wp.float64(SWEPT) * gone > size, TOO_FAST, PASSES)


@wp.func
def comes_between(
    here: BoxPlace,
    last: BoxPlace,
    half: wp.vec3d,
    gone: wp.float64,
    near: wp.float64,
    sides: wp.vec4d,
    deep: wp.float64,
):
    """Tells whether a box comes further into the image than `deep` between two instants, but at neither of them."""
    found = wp.bool(False)
    # What stays beyond one side all along does not come in, and what hardly moves not far.
    most_in = wp.max(last.image.inside, here.image.inside)
    if most_in < deep and (here.image.beyond & last.image.beyond) == 0:
        if most_in + gone / wp.min(last.image.ahead, here.image.ahead) > deep:
            for k in range(1, PIECES):
                g = wp.float64(k) / wp.float64(PIECES)
                centre = last.centre + g * (here.centre - last.centre)
                between = image_reach(centre, last.axes + g * (here.axes - last.axes), half, near, sides)
                found = found or between.inside > deep
    return found


@wp.func
def add_if_narrow(
    here: BoxPlace,
    last: BoxPlace,
    half: wp.vec3d,
    near: wp.float64,
    sides: wp.vec4d,
    scale: wp.float64,
    spacing: wp.float64,
    env: int,
    missed: wp.array2d(dtype=wp.float64),
):
    """Adds the pixels that a box goes over unseen between two instants to `missed` of an environment, if it is in the
    image at both and NARROW; other arguments as of follow_boxes."""
    if wp.min(here.centre[2], last.centre[2]) > near:
        add_missed(narrow_way(here.centre, here.axes, half, last.centre, sides, scale), spacing, env, missed)


@wp.kernel
def follow_boxes(
    # in
    boxes: Boxes,
    camera: int,
    near: wp.float64,
    sides: wp.vec4d,
    deep: wp.float64,
    scale: wp.float64,
    spacing: wp.float64,
    eye: wp.array(dtype=wp.transformd),
    poses: wp.array3d(dtype=wp.transformd),
    # out
    shortest: wp.array(dtype=int),
    passing: wp.array(dtype=int),
    missed: wp.array2d(dtype=wp.float64),
):
    """Follows a box through the instants of a gap, and finds what of it may go unseen between z-buffers.

    camera: its place among what moves, -1 where it stands at eye [E]. near: distance of the near plane [m]. sides:
    least and greatest x / z, then y / z, of the image; deep: in these. scale: pixels of a slope of 1. spacing: instants
    from one z-buffer to the next. poses [n, E, M]: at all instants, one after the other.

    shortest [E]: the shortest visit of a box to the image, in instants: one that begins and ends within the gap, and in
    which it comes further in than `deep`; 0 for one that does so between two instants alone. passing [E]: PASSES where
    one is on both sides of the near plane for a while, which hides part of it from one instant to the next, TOO_FAST
    where that is within too few of them; else 0. missed [E, levels]: pixels that NARROW boxes go over unseen, on the
    average, with z-buffers `spacing` instants apart, half as far, and so on.
    """
    env, j = wp.tid()
    half = boxes.half[j]
    before = wp.bool(True)
    stay = wp.int32(0)
    far_in = wp.float64(0.0)
    zero = wp.float64(0.0)
    last = BoxPlace()
    for n in range(poses.shape[0]):
        at = eye[env]
        if camera >= 0:
            at = poses[n, env, camera]
        here = place_of(boxes, j, poses[n, env, boxes.mover[j]], at, near, sides)
        if here.image.inside >= zero:
            if not before:
                stay += 1
                far_in = wp.max(far_in, here.image.inside)
        else:
            if stay > 0 and far_in > deep:
                wp.atomic_min(shortest, env, stay)
            before = wp.bool(False)
            stay = wp.int32(0)
            far_in = zero
        if n > 0:
            gone = wp.length(here.centre - last.centre) + wp.length((here.axes - last.axes) * half)
            inside = here.image.inside >= zero and last.image.inside >= zero
            if gone > zero and inside:
                add_if_narrow(here, last, half, near, sides, scale, spacing, env, missed)
            if gone * wp.float64(poses.shape[0]) > wp.float64(QUICK) * wp.length(half):
                wp.atomic_max(passing, env, passes_near_plane(here, last, half, gone, near))
            if comes_between(here, last, half, gone, near, sides, deep):
                wp.atomic_min(shortest, env, 0)
        last = here


@wp.kernel
def follow_still_boxes(
    # in
    env: wp.array(dtype=int),
    centre: wp.array(dtype=wp.vec3d),
    axes: wp.array(dtype=wp.mat33d),
    half: wp.array(dtype=wp.vec3d),
    near: wp.float64,
    sides: wp.vec4d,
    scale: wp.float64,
    spacing: wp.float64,
    eye: wp.array2d(dtype=wp.vec3d),
    back: wp.array2d(dtype=wp.mat33d),
    # out
    missed: wp.array2d(dtype=wp.float64),
):
    """Follows a box that stands still before a camera that moves, and adds to `missed` what of it may go unseen.

    env, centre, axes, half [J]: of the boxes, in the world. eye, back [n, E]: where the camera is at some instants, and
    the rotation from the world to it; spacing: instants of these from one z-buffer to the next. Other arguments as of
    follow_boxes.
    """
    j = wp.tid()
    e = env[j]
    zero = wp.float64(0.0)
    last = BoxPlace()
    for n in range(eye.shape[0]):
        here = box_place(back[n, e] * (centre[j] - eye[n, e]), back[n, e] * axes[j], half[j], near, sides)
        if n > 0 and here.image.inside >= zero and last.image.inside >= zero:
            add_if_narrow(here, last, half[j], near, sides, scale, spacing, e, missed)
        last = here
