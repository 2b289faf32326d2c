"""Looks up in a keyframe the point that a pixel sees at an instant: where it is there, and what is shown there."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.reading_kernels import element, number, pair, whole_number
from nodes.interpolator.refine.paths.motion_kernels import motion_since
from nodes.interpolator.refine.window_kernels import PixelInterval, WindowParameters, WindowScene
from nodes.interpolator.rigid.look_up.log_kernels import apart, log_type
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.lens.displacement_kernels import SKY_NEAR, make_displacement
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

NEARER = wp.constant(0.1)
"""Share of its inverse distance by which a keyframe shows a surface nearer where it cannot be the same part of it."""


@cache
def make_place_then(lens: str, channels: int, waveform_count: int) -> Any:
    """Makes the function `place_then`; arguments as of make_look_up."""
    Keyframes: Any = make_keyframes(channels, waveform_count)
    displacement, bent = make_displacement(lens), lens != "none"

    @wp.func
    def place_then(
        view: CameraView,
        params: WindowParameters,
        keys: Keyframes,
        scene: WindowScene,
        px: PixelInterval,
        which: int,
        i: int,
        body: int,
        away: float,
    ):
        """Computes where (x, y) [px] keyframe `which` shows the point that a pixel sees at instant i, and the inverse
        of its distance there [1/m].

        body: that the point is on. away: its distance along the ray, in multiples of `px.d`.
        """
        point = away * px.d
        motion = motion_since(params, scene, keys.motions, px.env, px.k, which, i, body)
        m = motion.turn * point + motion.shift
        near = wp.where(body == keys.motions.shape[1] - 1, SKY_NEAR, view.near)
        moved = displacement(view, px.d, point, m, near)
        q = point + m
        return wp.vec3(
            float(px.x) + moved[0], float(px.y) + moved[1], 1.0 / wp.where(wp.static(bent), wp.length(q), q[2])
        )

    return place_then


@cache
def make_point_look_up(channels: int, waveform_count: int) -> tuple[Any, Any, Any]:
    """Makes the functions `in_view`, `look_up_at` and `light_at`; arguments as of make_look_up."""
    Keyframes: Any = make_keyframes(channels, waveform_count)
    log_at = number if log_type(channels, waveform_count) is wp.float32 else element

    @wp.func
    def in_view(view: CameraView, keys: Keyframes, base: int, at: wp.vec3, sky: bool):
        """Tells whether all four pixels around a place are in the image, and what a keyframe shows there is not nearer
        than the place: of a ball that has turned it shows the other side."""
        if at[0] >= 0.0 and at[1] >= 0.0 and at[0] < float(view.width - 1) and at[1] < float(view.height - 1):
            shown = number(keys.inverse, base + int(at[1] + 0.5) * view.width + int(at[0] + 0.5))
            return sky or shown - at[2] <= NEARER * at[2]
        return False

    @wp.func
    def look_up_at(view: CameraView, keys: Keyframes, base: int, at: wp.vec2, patch: int):
        """Tells whether a keyframe shows a patch at a place, ln I there, and how far the four pixels about it differ.

        ln I is interpolated bilinearly, or the nearest pixel's where not all four show the patch.
        """
        # Rounding may put the end of a way onto the image's border.
        left = wp.min(int(at[0]), view.width - 2)
        top = wp.min(int(at[1]), view.height - 2)
        fx = at[0] - float(left)
        fy = at[1] - float(top)
        here = base + top * view.width + left
        below = here + view.width
        a = log_at(keys.logs, here)
        b = log_at(keys.logs, here + 1)
        c = log_at(keys.logs, below)
        d = log_at(keys.logs, below + 1)
        spread = apart(wp.min(wp.min(a, b), wp.min(c, d)), wp.max(wp.max(a, b), wp.max(c, d)))
        # One number tells where all is the patch, but at the border and of what never moves.
        one = whole_number(keys.support, here) >> 2 == patch
        if not one:
            upper_two = whole_number(keys.patch, here) == patch and whole_number(keys.patch, here + 1) == patch
            lower_two = whole_number(keys.patch, below) == patch and whole_number(keys.patch, below + 1) == patch
            one = upper_two and lower_two
        if one:
            upper = a + fx * (b - a)
            lower = c + fx * (d - c)
            return True, upper + fy * (lower - upper), spread
        nearest = here + int(fy + 0.5) * view.width + int(fx + 0.5)
        return whole_number(keys.patch, nearest) == patch, log_at(keys.logs, nearest), spread

    @wp.func
    def light_at(view: CameraView, keys: Keyframes, base: int, at: wp.vec2, patch: int):
        """Tells whether a keyframe shows a patch at a place, and ln of the light alone there, as `look_up_at` does."""
        left = wp.min(int(at[0]), view.width - 2)
        top = wp.min(int(at[1]), view.height - 2)
        fx = at[0] - float(left)
        fy = at[1] - float(top)
        here = base + top * view.width + left
        below = here + view.width
        one = whole_number(keys.support, here) >> 2 == patch
        if one:
            a = pair(keys.demodulated, here)
            b = pair(keys.demodulated, below)
            upper = a[0] + fx * (a[1] - a[0])
            lower = b[0] + fx * (b[1] - b[0])
            return True, upper + fy * (lower - upper)
        nearest = here + int(fy + 0.5) * view.width + int(fx + 0.5)
        return whole_number(keys.patch, nearest) == patch, number(keys.demodulated, nearest)

    return in_view, look_up_at, light_at
