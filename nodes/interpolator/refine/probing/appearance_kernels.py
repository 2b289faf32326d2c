"""Finds how long boxes that move stay in the image between two probes, from where their bodies are at every instant."""

import warp as wp

from nodes.interpolator.displacement_kernels import turn_of
from nodes.interpolator.refine.probing.box_kernels import Boxes, reach

wp.set_module_options({"enable_backward": False})

PIECES = wp.constant(64)
"""Parts of the way from one instant to the next at which a thing is looked for that may pass the image on it."""
QUICK = wp.constant(0.25)
"""Part of its size by which a thing about the near plane moves in a gap, at least, if it is to count."""


SWEPT = wp.constant(14.0)
"""Instants within which what passes the near plane is shown too seldom, if it goes by its own size in them: as it comes
near, all of it sweeps over every pixel."""
NARROW = wp.constant(1.0)
"""Width [px] of a thing along its way below which it may be on no pixel of an image that it is in."""
NARROW_NOT = wp.constant(wp.float64(wp.inf))
"""Width of what does not move in the image."""
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


@wp.struct
class NarrowWay:
    """Holds how narrow a box is along its way from one instant to the next, for how many instants it is on a pixel, and
    how many pixels it goes over."""

    width: wp.float64
    stay: wp.float64
    pixels: wp.float64


@wp.func
def narrow_way(
    centre: wp.vec3d, axes: wp.mat33d, half: wp.vec3d, last_centre: wp.vec3d, sides: wp.vec4d, scale: wp.float64
):
    """Measures the way of a box through the image between two instants. scale: pixels of a slope of 1."""
    zero = wp.float64(0.0)
    way = NarrowWay()
    step = wp.vec2d(
        scale * (centre[0] / centre[2] - last_centre[0] / last_centre[2]),
        scale * (centre[1] / centre[2] - last_centre[1] / last_centre[2]),
    )
    gone = wp.length(step)
    way.width = NARROW_NOT
    if gone > zero:
        along = step / gone
        # Of a side of the box what counts is how far it reaches in the image, where it is ahead.
        slope = wp.vec2d(centre[0] / centre[2], centre[1] / centre[2])
        forward = wp.vec3d(along[0], along[1], -(along[0] * slope[0] + along[1] * slope[1]))
        across = wp.vec3d(-along[1], along[0], along[1] * slope[0] - along[0] * slope[1])
        size = wp.float64(2.0) * scale / centre[2]
        way.width = size * reach(forward, wp.vec3d(), axes, half)
        way.stay = way.width / gone
        image = scale * wp.max(sides[1] - sides[0], sides[3] - sides[2])
        way.pixels = gone * wp.min(size * reach(across, wp.vec3d(), axes, half), image)
    return way


@wp.kernel
def find_appearances(
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
    """Finds the shortest visit of a box to the image, in instants: one that begins and ends within the gap, and in
    which it comes further in than `deep`; 0 for one that does so between two instants alone. passing [E]: PASSES where
    one is on both sides of the near plane for a while, which hides part of it from one instant to the next, TOO_FAST
    where that is within too few of them; else 0. missed [E, levels]: pixels that NARROW boxes go over unseen, on the
    average, with z-buffers `spacing` instants apart, half as far, and so on.

    camera: its place among what moves, -1 where it stands at eye [E]. sides: least and greatest x / z, then y / z, of
    the image; deep: in these. scale: pixels of a slope of 1. poses [n, E, M]: at the instants of a gap, one after the
    other.
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
        if gone > zero and way.inside >= zero and last.inside >= zero and wp.min(centre[2], last_centre[2]) > near:
            narrow = narrow_way(centre, axes, half, last_centre, sides, scale)
            if narrow.width < wp.float64(NARROW):
                apart = spacing
                for level in range(missed.shape[1]):
                    part = wp.max(wp.float64(1.0) - narrow.stay / apart, zero)
                    missed[env, level] = missed[env, level] + part * narrow.pixels
                    apart = apart / wp.float64(2.0)
        if shows and gone * wp.float64(poses.shape[0]) > wp.float64(QUICK) * wp.length(half):
            cuts = -reach(wp.vec3d(zero, zero, -wp.float64(1.0)), centre, axes, half) < near
            if cuts or ((way.beyond ^ last.beyond) & 1) == 1:
                size = wp.float64(2.0) * wp.max(wp.max(half[0], half[1]), half[2])
                fast = wp.float64(SWEPT) * gone > size
                wp.atomic_max(passing, env, wp.where(fast, TOO_FAST, PASSES))
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
