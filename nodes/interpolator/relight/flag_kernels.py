"""Narrows the changes of light that a body may see in a gap down to those that one of its points may see."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.relight.boxes_kernels import crossed, nearby
from nodes.interpolator.relight.change_kernels import AROUND, LIT_ANEW, MOVED, OPEN, SHADED, VIEWED, Change
from nodes.interpolator.relight.features import LightChanges
from nodes.renderer.raster.depth_kernels import triangle_of

wp.set_module_options({"enable_backward": False})


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
