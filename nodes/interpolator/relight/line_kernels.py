"""Draws lines through a pixel's light from one sub-frame to the next, where it is straight."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.relight.change_kernels import (
    LIT_ANEW,
    MOVED,
    Change,
    Point,
    first_caster,
    may_be_shaded,
    point_of,
)
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.relight.flag_kernels import make_narrow_flags
from nodes.interpolator.relight.light_kernels import make_irradiance, make_shaded
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of

wp.set_module_options({"enable_backward": False})


@wp.struct
class LightState:
    """Holds how a pixel's light is at a sub-frame: how many before it are known, ln of what falls on it with nothing in
    the way, by how much that has grown, and whether anything may be in the way.

    kink: by how much the growth differs from the one before; jump: whether a line may not end here.
    """

    known: int
    level: float
    growth: float
    kink: float
    hidden: bool
    jump: bool


@cache
def make_light_at(f: LightChanges) -> Any:
    """Makes the function `light_at`."""
    log_irradiance, _ = make_irradiance(f)
    shaded = make_shaded(f)
    narrow_flags = make_narrow_flags(f)

    @wp.func
    def light_at(change: Change, flag: int, env: int, row: int, s: Point):
        """Gives ln of the irradiance of a flagged point in a slot's row, and whether something may be in the way of a
        light."""
        level = float(0.0)
        here = narrow_flags(change, flag, env, row, s.instance, s.position)
        moved = (here & MOVED) != 0
        hidden = (here & LIT_ANEW) != 0
        if wp.static(f.relative):
            if moved and not hidden:
                level = log_irradiance(change, row, s)
        if wp.static(f.shadows):
            if not hidden and may_be_shaded(here, s):
                hidden = shaded(change, change.now, change.casters, row, s, first_caster(change, here), 0.0)
        return level, hidden

    return light_at


@cache
def make_light_state(changes: LightChanges) -> tuple[Any, Any]:
    """Makes the functions `light_state_at` and `light_state_at_end`. changes: of light in the scene."""
    light_at = make_light_at(changes)
    _, log_irradiance_then = make_irradiance(changes)

    @wp.func
    def light_state_at(
        change: Change,
        pieces: wp.array(dtype=wp.vec2i),
        env: int,
        row: int,
        hit: wp.uint64,
        d: wp.vec3,
        before: LightState,
    ):
        """Gives how the light of a pixel is in a slot's row, and whether it may have jumped since the sub-frame before.

        Args:
            pieces: body and patch of each triangle.
            env, row: environment, and row of the slot.
            hit: z-buffer entry of the pixel.
            d: its ray.
            before: its light at the sub-frame before.
        """
        lit = LightState()
        lit.known = 2
        t = triangle_of(hit)
        if wp.static(changes.relative or changes.shadows or changes.indirect):
            if t != MISS:
                flag = change.flags[env, pieces[t][0]]
                if flag != 0:
                    s = point_of(change, change.casters, row, hit, depth_of(hit) * d)
                    level, hidden = light_at(change, flag, env, row, s)
                    lit.level = level
                    lit.hidden = hidden
                    lit.known = wp.min(before.known + 1, 2)
                    lit.growth = level - before.level
                    if before.known == 2:
                        lit.kink = wp.abs(lit.growth - before.growth)
                    lit.jump = hidden or before.hidden or before.known == 0
        return lit

    @wp.func
    def light_state_at_end(
        change: Change,
        pieces: wp.array(dtype=wp.vec2i),
        env: int,
        row: int,
        row_b: int,
        hit: wp.uint64,
        d: wp.vec3,
        before: LightState,
    ):
        """Gives how the light of a pixel goes on from the last sub-frame, in a slot's `row`, to keyframe B, in its row;
        arguments as of `light_state_at`.

        Nothing is between the two, so that only by how much it grows matters to a line that ends there.
        """
        lit = LightState()
        lit.jump = before.hidden
        t = triangle_of(hit)
        if wp.static(changes.relative):
            if t != MISS and before.known == 2 and not before.hidden:
                if (change.flags[env, pieces[t][0]] & MOVED) != 0:
                    s = point_of(change, change.casters_then, row_b, hit, depth_of(hit) * d)
                    lit.kink = wp.abs(log_irradiance_then(change, row, row_b, s) - before.level - before.growth)
        return lit

    return light_state_at, light_state_at_end
