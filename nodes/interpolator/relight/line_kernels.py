"""Draws lines through a pixel's light from one sub-frame to the next, where it is straight."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.relight.change_kernels import MOVED, Change, make_light, make_log_irradiance, point_of
from nodes.interpolator.relight.features import LightChanges
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
def make_light_state(changes: LightChanges) -> tuple[Any, Any]:
    """Makes the functions `light_state_at` and `light_state_at_end`. changes: of light in the scene."""
    log_irradiance = make_log_irradiance(changes)
    _, _, log_irradiance_then = make_light(changes)

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
                    level, hidden = log_irradiance(change, flag, env, row, s)
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
