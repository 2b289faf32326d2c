"""What a pixel passes over between two coarse samples, looked up roughly in a keyframe: whether and where it bends."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.rigid.log_kernels import apart
from nodes.interpolator.rigid.look_up_kernels import make_displacement, make_keyframes
from nodes.renderer.raster.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})

LEAST_STEP = wp.constant(0.02)
"""Way [px] over a surface that tells nothing."""
MOST_STEPS = wp.constant(48)
PER_PIXEL = wp.constant(1.5)
"""Steps per pixel of a path."""


@wp.struct
class Way:
    """Says in which rows of `turn` and `shift` bodies are on the way between two coarse samples of a pixel: at its
    start and its end, -1 for the keyframe itself, and at the ends of its `parts` between, from `row` on, `stride` rows
    from one to the next."""

    start: int
    end: int
    row: int
    stride: int
    parts: int


@cache
def make_preview(lens: str, channels: int, flicker: bool) -> Any:
    """Makes the function `preview`; arguments as of make_look_up."""
    Keyframes: Any = make_keyframes(channels, flicker)
    displacement = make_displacement(lens)

    @wp.func
    def place_then(
        view: CameraView,
        keys: Keyframes,
        row: int,
        body: int,
        d: wp.vec3,
        away: float,
    ):
        """Gives how far [px] from a pixel the point `away` on its ray d was at a keyframe, if it is on a body as that
        is in a row of `turn` and `shift`; a row of -1: that is where it is now."""
        if row < 0:
            return wp.vec2(0.0, 0.0)
        point = away * d
        m = keys.turn[row, body] * point + keys.shift[row, body]
        return displacement(view, d, point, m, wp.where(body == keys.turn.shape[1] - 1, 1.0e-6, view.near))

    @wp.func
    def between_pixels(view: CameraView, keys: Keyframes, base: int, at: wp.vec2):
        """Interpolates log radiance linearly."""
        left = wp.floor(at[0])
        top = wp.floor(at[1])
        fx = at[0] - left
        fy = at[1] - top
        here = base + int(top) * view.width + int(left)
        below = here + view.width
        upper = (1.0 - fx) * keys.logs[here] + fx * keys.logs[here + 1]
        return (1.0 - fy) * upper + fy * ((1.0 - fx) * keys.logs[below] + fx * keys.logs[below + 1])

    @wp.func
    def inside(view: CameraView, at: wp.vec2):
        """Tells whether all pixels about a place are there."""
        return at[0] >= 0.0 and at[1] >= 0.0 and at[0] < float(view.width - 1) and at[1] < float(view.height - 1)

    @wp.func
    def preview(
        view: CameraView,
        keys: Keyframes,
        base: int,
        way: Way,
        patch: int,
        body: int,
        x: int,
        y: int,
        nearest: wp.vec2,
    ):
        """Gives by how much ln of a keyframe's radiance is off a straight line in time at most, on the way of a pixel
        over a surface, at which fraction of it, how much it changes in all, and whether it shows all of the way. base:
        of the keyframe. nearest: how far away the surface is at both ends."""
        whole = wp.bool(True)
        worst = wp.float32(0.0)
        where = wp.float32(0.5)
        d = pixel_ray(view, x, y)
        middle = wp.vec2(float(x), float(y))
        start = middle + place_then(view, keys, way.start, body, d, nearest[0])
        end = middle + place_then(view, keys, way.end, body, d, nearest[1])
        if not (inside(view, start) and inside(view, end)):
            none = keys.logs[base] - keys.logs[base]
            return worst, where, none, False
        first = between_pixels(view, keys, base, start)
        last = between_pixels(view, keys, base, end)
        before = start
        for n in range(1, way.parts + 1):
            after = end
            f1 = float(n) / float(way.parts)
            if n < way.parts:
                away = nearest[0] + f1 * (nearest[1] - nearest[0])
                row = way.row + (n - 1) * way.stride
                after = middle + place_then(view, keys, row, body, d, away)
                if not inside(view, after):
                    return worst, where, last - first, False
            step = after - before
            length = wp.length(step)
            if length > LEAST_STEP or n > 1:
                steps = wp.min(int(PER_PIXEL * length) + 1, MOST_STEPS)
                for k in range(1, steps + 1):
                    g = float(k) / float(steps)
                    at = before + g * step
                    f = (float(n - 1) + g) / float(way.parts)
                    here = base + int(at[1] + 0.5) * view.width + int(at[0] + 0.5)
                    if keys.patch[here] != patch:
                        whole = wp.bool(False)
                    elif f < 0.999:
                        value = between_pixels(view, keys, base, at)
                        off = apart(value, first + f * (last - first))
                        if off > worst:
                            worst = off
                            where = f
            before = after
        return worst, where, last - first, whole

    return preview
