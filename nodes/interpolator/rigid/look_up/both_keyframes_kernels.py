"""Looks up in both keyframes of a gap what a pixel shows, and puts the texture of the sub-frame on the light there."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.displacement_kernels import displaced
from nodes.interpolator.rigid.look_up.log_kernels import log_type, name_of
from nodes.interpolator.rigid.look_up.look_up_kernels import (
    DEMODULATED,
    HARD,
    HIDDEN,
    SEEN,
    VisiblePoint,
    make_keyframes,
    make_look_up,
)
from nodes.interpolator.rigid.look_up.portion_kernels import Portion
from nodes.interpolator.rigid.look_up.texture_kernels import make_log_albedo
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import Surfaces, VisibilityBuffer, pixel_at

wp.set_module_options({"enable_backward": False})


@cache
def make_look_ups(channels: int, waveform_count: int) -> Any:
    """Makes the struct of what both keyframes tell of a point; channels, waveform_count: as of `log_type`.

    state_a, state_b: of look_up_kernels. a, b: log radiance. at_rest: whether the point is where it was at B.
    """

    class LookUps:
        state_a: int
        state_b: int
        a: log_type(channels, waveform_count)  # type: ignore[valid-type]
        b: log_type(channels, waveform_count)  # type: ignore[valid-type]
        at_rest: wp.bool

    LookUps.__qualname__ = name_of("LookUps", channels, waveform_count)
    return wp.struct(LookUps)


@cache
def make_look_up_both(
    lens: str, channels: int, waveform_count: int, careful: bool, detailed: bool, textured: bool
) -> wp.Function:
    """Makes the function `look_up_both`; arguments as of make_look_up."""
    Keyframes: Any = make_keyframes(channels, waveform_count)
    LookUps: Any = make_look_ups(channels, waveform_count)
    look_up = make_look_up(lens, channels, waveform_count, careful, detailed, textured)

    @wp.func
    def look_up_both(
        view: CameraView,
        portion: Portion,
        keys: Keyframes,
        s: VisiblePoint,
        env: int,
        i: int,
        since: int,
        behind: int,
        count: int,
    ):
        """Looks up what a pixel shows in the first `count` keyframes, A and B.

        i: index of the sub-frame. since: of the body's displacement since A; behind: how far behind it that since B is.
        """
        looks = LookUps()
        base = env * view.height * view.width
        # Both by the same code, for which Warp must not know `count`: two copies would not fit a GPU's registers and
        # cache of instructions.
        for k in range(count):
            first = k == 0
            # What A does not tell without care is left to the careful look.
            asked = first or looks.state_a != HARD
            if asked:
                moved = displaced(keys.motions, since + k * behind, s.point)
                origin = base + wp.where(first, keys.first[0], keys.first[1])
                distant = portion.pace * float(wp.where(first, i, portion.upsampling - i))
                state, found = look_up(view, keys, origin, s, moved, portion.tolerance, distant)
                if first:
                    looks.state_a = state
                    looks.a = found
                else:
                    looks.state_b = state
                    looks.b = found
                    looks.at_rest = moved[0] == 0.0 and moved[1] == 0.0 and moved[2] == 0.0
        return looks

    return look_up_both


@cache
def make_remodulate(channels: int, waveform_count: int, kind: tuple[bool, bool, bool]) -> wp.Function:
    """Makes the function `remodulate`; arguments as of make_gather."""
    LookUps: Any = make_look_ups(channels, waveform_count)
    log_albedo = make_log_albedo(*kind)

    @wp.func
    def remodulate(
        view: CameraView,
        n: int,
        y: int,
        x: int,
        hit: wp.uint64,
        shown: VisibilityBuffer,
        surfaces: Surfaces,
        before: LookUps,
    ):
        """Adds to the light alone, where keyframes tell no more, the texture that a pixel shows; without one they show
        nothing."""
        looks = before
        texture = log_albedo(view, pixel_at(n, y, x), hit, shown, surfaces)
        if looks.state_a == DEMODULATED:
            looks.state_a = wp.where(texture == 0.0, HIDDEN, SEEN)
            looks.a += texture
        if looks.state_b == DEMODULATED:
            looks.state_b = wp.where(texture == 0.0, HIDDEN, SEEN)
            looks.b += texture
        return looks

    return remodulate
