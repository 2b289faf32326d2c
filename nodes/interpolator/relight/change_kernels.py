"""Tests whether the light on a surface point is, at an instant, what two keyframes let one expect of it.

Light that falls straight from lamps and sky is computed in closed form at the instant and at both keyframes: Lambert's
cosine, distance, cone, and how far the view and the lights have turned against a glossy surface, whose lobe is about
alpha wide. What may be in the way of light is asked of the casters' boxes. Where anything changes otherwise than evenly
the point must be shaded at its own time.
"""

from functools import cache
from typing import Any

import warp as wp

from evis.media.colour import REC709
from nodes.interpolator.displacement_kernels import displaced, turned_back
from nodes.interpolator.relight.boxes_kernels import Swept, crossed, make_cast, nearby
from nodes.interpolator.relight.features import LightChanges
from nodes.renderer.lights.light_kernels import AREA, Lights, make_light_directions
from nodes.renderer.lights.sky_kernels import Sky, make_sky
from nodes.renderer.raster.depth_kernels import triangle_of
from nodes.renderer.shadows.ray_kernels import CONVEX, PLANAR, Casters, rotation_of

wp.set_module_options({"enable_backward": False})

MOVED = wp.constant(1)
"""Flag of a body that moves against a light in the gap."""
SHADED = wp.constant(2)
"""Flag of one that does not, and on which shadows of others may move."""
LIT_ANEW = wp.constant(4)
"""Flag of one that light reaches over other surfaces and that moves, or whose light comes from something that does."""
VIEWED = wp.constant(8)
"""Flag of a point, if glossy, that the view may have turned against by more than its lobe is wide."""
AROUND = wp.constant(16)
"""Flag of one that stands still and is lit over other surfaces, some of which move."""
OPEN = wp.constant(32)
"""Flag of a point of something that moves, between which and all lights nothing but itself may be in the gap."""
MANY = wp.constant(16)
"""Casters from which on a shadow ray costs less than asking all their boxes."""
CARRIED = wp.constant(20.0)
"""How much ln I may change, of `even`, where the change is added to what the keyframes show."""
BRIGHTNESS = wp.constant(wp.vec3(*REC709))
LEAST_COSINE = wp.constant(0.1)
"""Least cosine between view and normal for which the width of a pixel on a surface is worked out."""


@wp.struct
class Change:
    """Holds the lights and casters of the slots (`now`, rows P E) and of both keyframes (`then`, rows 2 E).

    eye_then: cameras to world; place_then: where they are, as `place` of Swept. flags int32 [E, N + 1]: of bodies and
    the world, see MOVED. open int32 [E, I]: 1 for instances whose points are OPEN; of many casters, or lights that
    move, it has no elements. instance, normals: of
    triangles; alpha: of an instance's material, -1 for a plain one; half: of its box [m]; weight: luminance of lights.
    carried: 1 for instances whose radiance goes as what falls on them; least: least alpha there is. even: change of ln
    I that still counts as none;
    bend: by how much a line may be off; turned: angle, of alpha, up to which a highlight changes evenly; blur: from a
    shadow's edge, up to which a look-up in a keyframe mixes both sides of it [rad].
    """

    now: Lights
    then: Lights
    casters: Casters
    casters_then: Casters
    sky: Sky
    swept: Swept
    eye_then: wp.array(dtype=wp.mat33)
    place_then: wp.array(dtype=wp.vec3)
    flags: wp.array2d(dtype=int)
    open: wp.array2d(dtype=int)
    instance: wp.array(dtype=int)
    normals: wp.array(dtype=wp.vec3)
    alpha: wp.array(dtype=float)
    half: wp.array(dtype=wp.vec3)
    weight: wp.array(dtype=float)
    carried: wp.array(dtype=int)
    least: float
    even: float
    bend: float
    turned: float
    blur: float


@wp.struct
class Point:
    """Holds a surface point in the frame of a camera, with the normal that faces it and the instance it is of; skip:
    the caster that cannot shade it, or -1."""

    position: wp.vec3
    normal: wp.vec3
    instance: int
    skip: int


@wp.func
def point_of(change: Change, casters: Casters, row: int, hit: wp.uint64, position: wp.vec3):
    """Gives the surface point that a pixel shows; casters, row: of the slots and its row, or of the keyframes."""
    t = triangle_of(hit)
    s = Point()
    s.position = position
    s.instance = change.instance[t]
    s.normal = rotation_of(casters, row, s.instance) * change.normals[t]
    shell = casters.shell[s.instance]
    s.skip = -1
    if wp.dot(s.normal, position) > 0.0:
        s.normal = -s.normal
        if shell == PLANAR:
            s.skip = s.instance
    elif shell == PLANAR or shell == CONVEX:
        s.skip = s.instance
    return s


@wp.struct
class Displacements:
    """Holds how the bodies of slots have moved since keyframe A, then since B, as displacement_kernels has it; entry
    `at` of a body in memory, `behind` more of the same since B."""

    turn: wp.array2d(dtype=wp.mat33)
    shift: wp.array2d(dtype=wp.vec3)
    at: int
    behind: int


@wp.func
def point_then(s: Point, moves: Displacements, k: int):
    """Computes where a point is in the camera frame of keyframe A (k = 0) or B (1)."""
    at = moves.at + k * moves.behind
    r = s
    r.position = s.position + displaced(moves.turn, moves.shift, at, s.position)
    r.normal = turned_back(moves.turn, at, s.normal)
    return r


@wp.func
def in_the_open(flag: int, s: Point):
    """Tells whether nothing can shade a point that is OPEN, not even its own instance."""
    return (flag & OPEN) != 0 and s.skip == s.instance


@cache
def make_light(f: LightChanges) -> tuple[Any, Any, Any]:
    """Makes the functions `irradiance`, `shaded` and `log_irradiance_then`."""
    light_direction, _ = make_light_directions(f.directional, f.point or f.area, f.spot)
    _, ambient, _ = make_sky(f.mapped)
    cast = make_cast(f)

    @wp.func
    def irradiance(change: Change, lights: Lights, row: int, sky_row: int, s: Point, up: wp.vec3):
        """Computes the irradiance of a point, as luminance, with nothing in the way. up: its normal in the camera
        frame of sky_row."""
        e = wp.pi * wp.dot(BRIGHTNESS, ambient(change.sky, sky_row, up))
        for l in range(lights.kind.shape[0]):
            ray, _length, strength = light_direction(lights, row, l, s.position)
            cosine = wp.dot(s.normal, ray)
            if cosine > 0.0:
                share = cosine * strength * change.weight[l]
                if wp.static(f.area):
                    if lights.kind[l] == AREA:
                        facing = wp.dot(wp.cross(lights.half_u[row, l], lights.half_v[row, l]), ray)
                        share *= 4.0 * wp.abs(facing)
                e += share
        return e

    @wp.func
    def shaded(change: Change, lights: Lights, casters: Casters, row: int, s: Point, first: int, around: float):
        """Tells whether casters from order[first] on may be between a light and what it shines on within a distance
        `around` of a point [m]."""
        for l in range(lights.kind.shape[0]):
            if lights.shadow[l] == 1:
                ray, length, strength = light_direction(lights, row, l, s.position)
                wide = float(0.0)
                if wp.static(f.area):
                    if lights.kind[l] == AREA:
                        wide = wp.length(lights.half_u[row, l]) + wp.length(lights.half_v[row, l])
                if wp.dot(s.normal, ray) * length > -wide and strength > 0.0:
                    if casters.order.shape[0] - first > MANY:
                        return True
                    if cast(casters, change.half, row, first, s.skip, s.position, ray, length, wide, around):
                        return True
        return False

    @wp.func
    def log_irradiance_then(change: Change, row: int, row_then: int, then: Point):
        """Computes ln of the irradiance of a point at a keyframe, which has row_then; row: of any slot."""
        up = wp.transpose(change.casters.turn[row]) * (change.eye_then[row_then] * then.normal)
        return wp.log(wp.max(irradiance(change, change.then, row_then, row, then, up), 1.0e-30))

    return irradiance, shaded, log_irradiance_then


@cache
def make_half_vector_turn(f: LightChanges) -> Any:
    """Makes the function `half_vector_turn`."""
    light_direction, _ = make_light_directions(f.directional, f.point or f.area, f.spot)

    @wp.func
    def half_vector_turn(change: Change, row: int, row_then: int, s: Point, then: Point, moved: bool):
        """Bounds by how much the half vectors of view and lights have turned against the normal since a keyframe
        [rad]."""
        eye = change.casters.turn[row]
        eye_then = change.eye_then[row_then]
        seen = eye * wp.normalize(s.position) - eye_then * wp.normalize(then.position)
        angle = 0.5 * wp.length(seen)
        if moved:
            most = float(0.0)
            for l in range(change.now.kind.shape[0]):
                ray, _length, _strength = light_direction(change.now, row, l, s.position)
                before, _length_then, _strength_then = light_direction(change.then, row_then, l, then.position)
                most = wp.max(most, wp.length(eye * ray - eye_then * before))
            angle += 0.5 * most + wp.length(eye * s.normal - eye_then * then.normal)
        return angle

    return half_vector_turn


@cache
def make_relit(f: LightChanges) -> Any:
    """Makes the function `relit`."""
    irradiance, shaded, log_irradiance_then = make_light(f)
    half_vector_turn = make_half_vector_turn(f)

    @wp.func
    def blurred(change: Change, then: Point):
        """Gives how far from a point [m] a look-up in the keyframe takes in what is beside it."""
        away = wp.length(then.position)
        cosine = wp.abs(wp.dot(then.normal, then.position)) / away
        return change.blur * away / wp.max(cosine, LEAST_COSINE)

    @wp.func
    def relit(
        change: Change,
        flag: int,
        row: int,
        row_a: int,
        row_b: int,
        s: Point,
        moves: Displacements,
        seen_a: bool,
        seen_b: bool,
        share: float,
    ):
        """Tells whether a point must be shaded at its own time, where keyframe A (row_a), B or both show it and are
        blended by `share`; and otherwise by how much ln of its radiance is above what A shows, and B. flag: of
        `point_flags`."""
        above_a = float(0.0)
        above_b = float(0.0)
        moved = (flag & MOVED) != 0
        # One after the other by the same code, of which two copies would not fit a GPU's cache of instructions.
        begin = wp.where(seen_a, 0, 1)
        end = wp.where(seen_b, 2, 1)
        if wp.static(f.indirect):
            if (flag & LIT_ANEW) != 0:
                return True, above_a, above_b
        if wp.static(f.view):
            alpha = change.alpha[s.instance]
            if alpha >= 0.0 and (flag & VIEWED) != 0:
                angle = float(0.0)
                for k in range(begin, end):
                    then = point_then(s, moves, k)
                    angle += half_vector_turn(change, row, wp.where(k == 0, row_a, row_b), s, then, moved)
                if angle > alpha * change.turned:
                    return True, above_a, above_b
        if wp.static(f.relative):
            if moved:
                level = wp.log(wp.max(irradiance(change, change.now, row, row, s, s.normal), 1.0e-30))
                for k in range(begin, end):
                    then = point_then(s, moves, k)
                    above = level - log_irradiance_then(change, row, wp.where(k == 0, row_a, row_b), then)
                    if k == 0:
                        above_a = above
                    else:
                        above_b = above
                if change.carried[s.instance] == 1:
                    if wp.max(wp.abs(above_a), wp.abs(above_b)) > CARRIED * change.even:
                        return True, above_a, above_b
                else:
                    expected = wp.where(seen_b, 1.0 - share, 1.0) * above_a + wp.where(seen_a, share, 1.0) * above_b
                    if wp.abs(expected) > change.even:
                        return True, above_a, above_b
                    above_a = float(0.0)
                    above_b = float(0.0)
        if wp.static(f.shadows):
            if (moved and not in_the_open(flag, s)) or (flag & SHADED) != 0:
                first = wp.where(moved, 0, change.casters.still)
                if shaded(change, change.now, change.casters, row, s, first, 0.0):
                    return True, above_a, above_b
                for k in range(begin, end):
                    then = point_then(s, moves, k)
                    # A keyframe by itself blurs the edges of its shadows, of two the other one tells.
                    around = float(0.0)
                    if end - begin == 1:
                        around = blurred(change, then)
                    row_then = wp.where(k == 0, row_a, row_b)
                    if shaded(change, change.then, change.casters_then, row_then, then, first, around):
                        return True, above_a, above_b
        return False, above_a, above_b

    return relit


@cache
def make_narrow_flags(f: LightChanges) -> Any:
    """Makes the function `narrow_flags`."""

    @wp.func
    def narrow_flags(change: Change, flag: int, env: int, row: int, instance: int, position: wp.vec3):
        """Gives the flags of a point of an instance, of those of its body: SHADED only where a shadow may pass in the
        gap, OPEN where that is so, and AROUND becomes LIT_ANEW near what moves, else 0."""
        left = flag
        if wp.static(f.shadows):
            if (flag & MOVED) != 0 and change.open.shape[0] > 0:
                if change.open[env, instance] == 1:
                    left = left | OPEN
            if (flag & SHADED) != 0:
                if not crossed(change.swept, env, change.casters.turn[row], row, instance, position):
                    left = left & ~SHADED
        if wp.static(f.indirect):
            if (flag & AROUND) != 0:
                left = left & ~AROUND
                if nearby(change.swept, env, change.casters.turn[row], row, position) > 2.0 * change.even:
                    left = left | LIT_ANEW
        return left

    return narrow_flags


@cache
def make_point_flags(f: LightChanges) -> Any:
    """Makes the function `point_flags`."""
    narrow_flags = make_narrow_flags(f)

    @wp.func
    def point_flags(
        change: Change, body: int, env: int, row: int, hit: wp.uint64, position: wp.vec3, to_a: wp.vec3, to_b: wp.vec3
    ):
        """Gives the flags of a point for `relit`, 0 where its light cannot change otherwise than evenly, which a few
        cheap bounds tell of most points.

        to_a, to_b: how far the cameras of both keyframes are from that of the row [m].
        """
        flag = narrow_flags(change, change.flags[env, body], env, row, change.instance[triangle_of(hit)], position)
        if wp.static(f.view):
            if (flag & MOVED) != 0:
                flag = flag | VIEWED
            else:
                # Of what does not move the view turns by no more than the cameras are apart.
                apart = wp.length(to_a) + wp.length(to_b)
                far = 2.0 * change.turned * wp.length(position)
                if apart > change.least * far:
                    alpha = change.alpha[change.instance[triangle_of(hit)]]
                    if alpha >= 0.0 and apart > alpha * far:
                        flag = flag | VIEWED
        return flag

    return point_flags


@cache
def make_log_irradiance(f: LightChanges) -> Any:
    """Makes the function `log_irradiance`."""
    irradiance, shaded, _ = make_light(f)
    narrow_flags = make_narrow_flags(f)

    @wp.func
    def log_irradiance(change: Change, flag: int, env: int, row: int, s: Point):
        """Gives ln of the irradiance of a flagged point in a slot's row, and whether something may be in the way of a
        light."""
        level = float(0.0)
        here = narrow_flags(change, flag, env, row, s.instance, s.position)
        moved = (here & MOVED) != 0
        hidden = (here & LIT_ANEW) != 0
        if wp.static(f.relative):
            if moved and not hidden:
                level = wp.log(wp.max(irradiance(change, change.now, row, row, s, s.normal), 1.0e-30))
        if wp.static(f.shadows):
            if not hidden and ((moved and not in_the_open(here, s)) or (here & SHADED) != 0):
                first = wp.where(moved, 0, change.casters.still)
                hidden = shaded(change, change.now, change.casters, row, s, first, 0.0)
        return level, hidden

    return log_irradiance
