"""Computes where casters sweep in a gap, and finds pixels that seem to show the same all through it although a shadow
passes."""

import warp as wp

from nodes.interpolator.relight.boxes_kernels import bit, crossed, nearby, way_to
from nodes.interpolator.relight.change_kernels import AROUND, LEAST_COSINE, LIT_ANEW, SHADED, Change
from nodes.renderer.raster.depth_kernels import MISS, NO_ENTRY, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray
from nodes.renderer.shadows.ray_kernels import hits_box, inverse_of

wp.set_module_options({"enable_backward": False})

ROUNDED_TWICE = wp.constant(1.0e-4)
"""Error of a place, of its distance, here and at the points, whose tests add ROUNDED themselves."""


@wp.kernel
def place_cameras(
    # in
    poses: wp.array2d(dtype=wp.transformd),
    camera: int,
    origin: wp.vec3d,
    # out
    place: wp.array(dtype=wp.vec3),
):
    """Computes where the cameras of poses [R, N] are, in the world's axes about an origin [m]."""
    row = wp.tid()
    place[row] = wp.vec3(wp.transform_get_translation(poses[row, camera]) - origin)


@wp.func
def sides_of(turn: wp.mat33, half: wp.vec3):
    """Gives half the sides of the box, along the axes, about a turned box with these half sides [m]."""
    sides = wp.vec3()
    for k in range(3):
        sides[k] = wp.abs(turn[k, 0]) * half[0] + wp.abs(turn[k, 1]) * half[1] + wp.abs(turn[k, 2]) * half[2]
    return sides


@wp.kernel
def find_shaded(
    # in
    change: Change,
    # out
    masks: wp.array3d(dtype=wp.uint32),
):
    """Computes `masks` of Swept, for instances as they are in the first slot.

    Where a light's way to the middle of an instance meets the box of what moves, made larger by the instance's own, a
    point of it may be shaded; where it does not, none is.
    """
    env, i = wp.tid()
    swept = change.swept
    eye = change.casters.turn[env]
    seen = change.casters.translation[env, i]
    middle = eye * seen + swept.place[env]
    sides = sides_of(eye * change.casters.rotation[env, i], change.half[i])
    # For what is rounded in single precision here and at the points.
    pad = ROUNDED_TWICE * (wp.length(seen) + wp.length(middle) + wp.length(sides))
    pad += swept.blur * (wp.length(seen) + wp.length(sides))
    for l in range(swept.lamp.shape[0]):
        mask = wp.uint32(0)
        way, length = way_to(swept, l, middle)
        wide = sides + (pad + swept.radius[l]) * wp.vec3(1.0, 1.0, 1.0)
        inverse = inverse_of(way)
        for k in range(1, swept.lower.shape[1]):
            if hits_box(swept.lower[env, k] - middle - wide, swept.upper[env, k] - middle + wide, inverse, length):
                mask = mask | bit(k - 1)
        masks[env, i, l] = mask


@wp.func
def box_of(change: Change, body: wp.array(dtype=int), env: int, i: int):
    """Gives the middle and half the sides of a box about an instance at all instants of the gap, as `Swept` has them;
    body: as of find_open."""
    swept = change.swept
    k = body[i]
    if k > 0:
        return 0.5 * (swept.lower[env, k] + swept.upper[env, k]), 0.5 * (swept.upper[env, k] - swept.lower[env, k])
    eye = change.casters.turn[env]
    sides = sides_of(eye * change.casters.rotation[env, i], change.half[i])
    return eye * change.casters.translation[env, i] + swept.place[env], sides


@wp.kernel
def find_open(
    # in
    change: Change,
    to_b: int,
    body: wp.array(dtype=int),
    # out
    open: wp.array2d(dtype=int),
):
    """Computes `open` of Change: no other caster's box meets the way from any point of an instance to a light.

    to_b: rows from keyframe A of an environment to its B. body [I]: of instances that may move their body's number in
    `lower`, 0 for others, which are where they are in the first slot. As in find_shaded, what is in the way of the
    middle is made larger by half the instance's sides.
    """
    env, i = wp.tid()
    swept = change.swept
    result = wp.int32(0)
    if body[i] > 0:
        result = wp.int32(1)
        middle, sides = box_of(change, body, env, i)
        to_one = wp.length(middle - change.place_then[env])
        to_other = wp.length(middle - change.place_then[env + to_b])
        away = wp.max(to_one, to_other) + wp.length(sides)
        # As far beside a point as `relit` looks at most, in either keyframe.
        pad = ROUNDED_TWICE * (away + wp.length(middle)) + change.blur / LEAST_COSINE * away
        for l in range(swept.lamp.shape[0]):
            way, length = way_to(swept, l, middle)
            wide = sides + (pad + swept.radius[l]) * wp.vec3(1.0, 1.0, 1.0)
            inverse = inverse_of(way)
            for n in range(change.casters.order.shape[0]):
                j = change.casters.order[n]
                if j != i:
                    centre, other = box_of(change, body, env, j)
                    if hits_box(centre - middle - other - wide, centre - middle + other + wide, inverse, length):
                        result = wp.int32(0)
    open[env, i] = result


@wp.kernel
def exclude_relit(
    # in
    view: CameraView,
    span: int,
    change: Change,
    pieces: wp.array(dtype=wp.vec2i),
    # in and out
    unchanged: wp.array3d(dtype=wp.uint64),
):
    """Writes NO_ENTRY over entries [E, H, W] of pixels whose light something that moves may cross in the gap.

    Keyframe B is in the first slot. pieces: body and patch of each triangle.
    """
    env, y, part = wp.tid()
    for x in range(part * span, wp.min(part * span + span, unchanged.shape[2])):
        entry = unchanged[env, y, x]
        t = triangle_of(entry)
        if entry != NO_ENTRY and t != MISS:
            flag = change.flags[env, pieces[t][0]]
            touched = (flag & LIT_ANEW) != 0
            position = depth_of(entry) * pixel_ray(view, x, y)
            eye = change.casters.turn[env]
            if (flag & AROUND) != 0 and not touched:
                touched = nearby(change.swept, env, eye, env, position) > 2.0 * change.even
            if (flag & SHADED) != 0 and not touched:
                touched = crossed(change.swept, env, eye, env, change.instance[t], position)
            if touched:
                unchanged[env, y, x] = NO_ENTRY
