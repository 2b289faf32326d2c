"""Tests whether the light on a surface point is, at an instant, what two keyframes let one expect of it.

Light is compared at the instant and at the keyframes that show the point: what falls on it, what may be in the way, and
how far the view and the lights have turned against a glossy surface, whose lobe is about alpha wide. Where anything
changes otherwise than evenly the point must be shaded at its own time.
"""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.relight.change_kernels import (
    LEAST_COSINE,
    LIT_ANEW,
    MOVED,
    VIEWED,
    Change,
    Displacements,
    Point,
    first_caster,
    may_be_shaded,
    point_then,
)
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.relight.light_kernels import make_irradiance, make_shaded
from nodes.renderer.lights.light_kernels import make_light_directions

wp.set_module_options({"enable_backward": False})

CARRIED = wp.constant(20.0)
"""How much ln I may change, of `even`, where the change is added to what the keyframes show."""


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
    log_irradiance, log_irradiance_then = make_irradiance(f)
    shaded = make_shaded(f)
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
                level = log_irradiance(change, row, s)
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
            if may_be_shaded(flag, s):
                first = first_caster(change, flag)
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
