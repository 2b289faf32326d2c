"""Looks up a surface point in a keyframe: where it is there, whether it is seen, and its log radiance."""

import math
from functools import cache
from typing import Any

import warp as wp

from evis.gpu.reading_kernels import element, number, pair, pair_of, weighted, whole_number, whole_pair
from nodes.interpolator.displacement_kernels import BodyMotion
from nodes.interpolator.rigid.keyframe_kernels import STRAIGHT, WHOLE
from nodes.interpolator.rigid.look_up.log_kernels import apart, half_black, least, log_type, most, name_of, within
from nodes.renderer.raster.lens.displacement_kernels import FAR_AWAY, SKY_NEAR, make_displacement
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

SAME_POINT = wp.constant(3.0e-3)
"""Difference of inverse distances, of the inverse distance, up to which a keyframe shows the point that is looked for
and not one before or behind it on the same patch."""
SAME_SHEET = wp.constant(3.0e-2)
"""The same, for the pixels about it: a surface seen at a slant is as much nearer from one to the next."""
STEEP = wp.constant(3.0)
"""Differences of log radiance, in tolerances, between neighbours beside which a patch must be seen in full."""
FINE = wp.constant(0.03)
"""Difference of cubic and linear interpolation, in tolerances, above which what a surface shows is too fine for its
keyframes: interpolation would dull it by about as much."""
EVEN, NEARLY_EVEN = wp.constant(0.08), wp.constant(0.8)
"""Differences of ln of the light, in tolerances, among four pixels between which it is interpolated linearly: where
more pixels would tell how it bends, and where a patch is seen in part."""
NO_ALBEDO = wp.constant(math.inf)
"""Stands for ln of the light on a texture where there is none; no mean of it and others is finite."""
ENOUGH = wp.constant(5)
"""Pixels about a place, of 16, that tell how even a patch is there."""
HIDDEN = wp.constant(0)
SEEN = wp.constant(1)
HARD = wp.constant(2)
DEMODULATED = wp.constant(3)
"""Seen, but for the texture: the value is ln of the light alone, which the texture at the time is to be added to."""


@cache
def make_keyframes(channels: int, waveform_count: int) -> Any:
    """Makes the struct of both keyframes of a gap, as `PreparedKeyframe` has them, in arrays of both [2 E H W], and how
    the bodies [2 P E, N + 2] of the sub-frames have moved since A, then since B: see displacement_kernels. first: where
    A and B begin; image: of B. channels, waveform_count: as of `log_type`."""

    class Keyframes:
        first: wp.vec2i
        image: wp.array3d(dtype=log_type(channels, 0))  # type: ignore[valid-type]
        patch: wp.array(dtype=int)
        support: wp.array(dtype=int)
        inverse: wp.array(dtype=float)
        logs: wp.array(dtype=log_type(channels, waveform_count))
        demodulated: wp.array(dtype=float)
        texels: wp.array(dtype=wp.vec4)
        motions: wp.array2d(dtype=BodyMotion)

    Keyframes.__qualname__ = name_of("Keyframes", channels, waveform_count)
    return wp.struct(Keyframes)


@wp.struct
class VisiblePoint:
    """Holds what a pixel shows: its ray d, the point on it, both in the camera frame, and of which patch; sky: 1 for
    that."""

    y: int
    x: int
    d: wp.vec3
    point: wp.vec3
    patch: int
    sky: int


@wp.func
def weights(f: float):
    """Gives the weights of cubic convolution (Keys 1981, a = -1/2) at the fraction f between the middle two of four
    samples."""
    return wp.vec4(
        ((1.0 - 0.5 * f) * f - 0.5) * f,
        (1.5 * f - 2.5) * f * f + 1.0,
        ((2.0 - 1.5 * f) * f + 0.5) * f,
        (0.5 * f - 0.5) * f * f,
    )


TEXEL = """
#if defined(__CUDA_ARCH__)
    const float4 t = __ldg(reinterpret_cast<const float4*>(texels.data) + at);
    return wp::vec_t<4, wp::float32>(t.x, t.y, t.z, t.w);
#else
    return texels.data[at];
#endif
"""


@wp.func_native(TEXEL)
def texel(texels: wp.array(dtype=wp.vec4), at: wp.int32) -> wp.vec4:
    """Reads a pixel's patch (its bits), inverse distance and, in luminance, log radiance, read at once."""
    ...


@wp.func
def shows(t: wp.vec4, p: int, w: float):
    """Tells whether a pixel shows patch p at about the inverse distance w."""
    return wp.cast(t[0], wp.int32) == p and wp.abs(t[1] - w) <= SAME_SHEET * w


@wp.func
def is_demodulated(value: float):
    """Tells whether a mean of ln of the light is of textures alone."""
    return wp.isfinite(value)


@wp.func
def in_column(r0: Any, r1: Any, r2: Any, r3: Any, wy: wp.vec4):
    """Combines four rows by their weights."""
    value = wy[0] * r0 + wy[1] * r1
    value += wy[2] * r2
    value += wy[3] * r3
    return value


@cache
def make_fetches(channels: int, waveform_count: int) -> tuple[wp.Function, wp.Function, wp.Function, wp.Function]:
    """Makes the functions `log_of`, and `whole`, `masked` and `edge` of places about which a patch is seen in full, in
    the middle, and in part; channels, waveform_count: as of `log_type`."""
    Keyframes: Any = make_keyframes(channels, waveform_count)
    pixel = log_type(channels, waveform_count)
    log_at = number if pixel is wp.float32 else element

    @wp.func
    def whole(keys: Keyframes, width: int, at: int, wx: wp.vec4, wy: wp.vec4):
        """Computes cubic convolution about the pixel `at` and its neighbours to the right and below."""
        first = at - 1
        below = first + width
        return in_column(
            weighted(keys.logs, first - width, wx),
            weighted(keys.logs, first, wx),
            weighted(keys.logs, below, wx),
            weighted(keys.logs, below + width, wx),
            wy,
        )

    @wp.func
    def log_of(keys: Keyframes, t: wp.vec4, at: int):
        """Gives the log radiance of a pixel, from its texel where that holds it."""
        if wp.static(pixel is wp.float32):
            return t[2]
        else:
            return keys.logs[at]

    @wp.func
    def masked_row(keys: Keyframes, row: int, core: int, p: int, w: float, wx: wp.vec4):
        """Weights a row of `masked`; core: the nearest row of the middle."""
        # All are read before any is used, for a GPU waits once then.
        t0 = texel(keys.texels, row - 1)
        t1 = texel(keys.texels, row)
        t2 = texel(keys.texels, row + 1)
        t3 = texel(keys.texels, row + 2)
        a = log_of(keys, t1, row)
        b = log_of(keys, t2, row + 1)
        if not shows(t1, p, w):
            a = log_at(keys.logs, core)
        if not shows(t2, p, w):
            b = log_at(keys.logs, core + 1)
        far_left = a
        far_right = b
        if shows(t0, p, w):
            far_left = log_of(keys, t0, row - 1)
        if shows(t3, p, w):
            far_right = log_of(keys, t3, row + 2)
        return wx[0] * far_left + wx[1] * a + wx[2] * b + wx[3] * far_right

    @wp.func
    def masked(keys: Keyframes, width: int, at: int, p: int, w: float, wx: wp.vec4, wy: wp.vec4):
        """Computes cubic convolution where only the middle four of the 4 x 4 pixels are sure to belong to the patch:
        each of the others that does not is replaced by the next one of the middle."""
        below = at + width
        return in_column(
            masked_row(keys, at - width, at, p, w, wx),
            masked_row(keys, at, at, p, w, wx),
            masked_row(keys, below, below, p, w, wx),
            masked_row(keys, below + width, below, p, w, wx),
            wy,
        )

    @wp.func
    def edge(keys: Keyframes, width: int, at: int, p: int, w: float, fx: float, fy: float, tolerance: float):
        """Gives (state, log radiance) where not even the middle four all belong to the patch: the bilinear mean of
        those that do, if the patch is so even here, over ENOUGH of the 4 x 4 pixels or more, that it cannot be far
        off."""
        total = pixel(0.0)
        weight = wp.float32(0.0)
        low = pixel(1.0e30)
        high = pixel(-1.0e30)
        count = wp.int32(0)
        for j in range(4):
            for i in range(4):
                here = at + (j - 1) * width + i - 1
                t = texel(keys.texels, here)
                value = log_of(keys, t, here)
                if shows(t, p, w):
                    low = least(low, value)
                    high = most(high, value)
                    count += 1
                    if i >= 1 and i <= 2 and j >= 1 and j <= 2:
                        share = wp.where(i == 1, 1.0 - fx, fx) * wp.where(j == 1, 1.0 - fy, fy)
                        total += share * value
                        weight += share
        if count >= ENOUGH and weight > 0.01 and apart(low, high) <= tolerance:
            return SEEN, total / weight
        return HIDDEN, total

    return log_of, whole, masked, edge


@cache
def make_look_up(
    lens: str, channels: int, waveform_count: int, careful: bool, detailed: bool, textured: bool
) -> wp.Function:
    """Makes the function `look_up`, which finds the light of a point in a keyframe.

    lens: `none` or a distortion model. channels: 1 (luminance) or 3 (RGB). waveform_count: as of `log_type`. careful:
    also where a patch is not seen in full. detailed: what is finer than the keyframe's pixels is not found; textured:
    of textures that are, the light alone is.
    """
    bent = lens != "none"
    Keyframes: Any = make_keyframes(channels, waveform_count)
    pixel = log_type(channels, waveform_count)
    displacement = make_displacement(lens)
    log_of, whole, masked, edge = make_fetches(channels, waveform_count)

    @wp.func
    def nearness(s: VisiblePoint, q: wp.vec3):
        """Gives the inverse distance of a point [1/m], 0 of the sky."""
        if s.sky == 1:
            return 0.0
        return 1.0 / wp.where(wp.static(bent), wp.length(q), q[2])

    @wp.func
    def where_it_was(keys: Keyframes, s: VisiblePoint, at: int):
        """Looks up a point that has not moved: at the same pixel, if nothing hid it."""
        t = texel(keys.texels, at)
        w = nearness(s, s.point)
        if wp.cast(t[0], wp.int32) == s.patch and wp.abs(t[1] - w) <= SAME_POINT * w:
            return SEEN, log_of(keys, t, at)
        return HIDDEN, pixel(0.0)

    @wp.func
    def demodulated(keys: Keyframes, width: int, at: int, whole: bool, fx: float, fy: float, tolerance: float):
        """Computes ln of the light alone that falls on a texture; a number that `is_demodulated` refuses where one of
        the pixels has none. whole: whether the patch is seen in full, without which light has to be nearly even."""
        below = at + width
        a = pair(keys.demodulated, at)
        b = pair(keys.demodulated, below)
        low = wp.min(wp.min(a), wp.min(b))
        high = wp.max(wp.max(a), wp.max(b))
        if high - low <= wp.where(whole, EVEN, NEARLY_EVEN) * tolerance:
            upper = (1.0 - fx) * a[0] + fx * a[1]
            return (1.0 - fy) * upper + fy * ((1.0 - fx) * b[0] + fx * b[1])
        if not whole:
            return NO_ALBEDO
        wx = weights(fx)
        return in_column(
            weighted(keys.demodulated, at - 1 - width, wx),
            weighted(keys.demodulated, at - 1, wx),
            weighted(keys.demodulated, below - 1, wx),
            weighted(keys.demodulated, below - 1 + width, wx),
            weights(fy),
        )

    @wp.func
    def about(
        view: CameraView,
        keys: Keyframes,
        s: VisiblePoint,
        at: int,
        fx: float,
        fy: float,
        w: float,
        tolerance: float,
        fine: bool,
    ):
        """Looks up a point at the fraction (fx, fy) between the pixel `at` and the next; w: its inverse distance; fine:
        whether what is finer than pixels matters."""
        width = view.width
        below = at + width
        seen = wp.int32(HIDDEN)
        value = pixel(0.0)
        code = whole_number(keys.support, at)
        near = pair(keys.inverse, at)
        near_below = pair(keys.inverse, below)
        if (code >> 2) == s.patch and code >= 0:
            upper = near[0] * (1.0 - fx) + near[1] * fx
            lower = near_below[0] * (1.0 - fx) + near_below[1] * fx
            a, b = pair_of(keys.logs, at)
            c, d = pair_of(keys.logs, below)
            low = least(least(a, b), least(c, d))
            high = most(most(a, b), most(c, d))
            near_enough = wp.abs(upper * (1.0 - fy) + lower * fy - w) <= SAME_POINT * w
            near_enough = near_enough and not half_black(low, high)
            straight = (1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * c + fx * d)
            spread = apart(low, high)
            # Of one colour cubic convolution would only bring in what is beside it. Textures may alias to one colour.
            linear = spread <= FINE * tolerance
            if wp.static(textured):
                linear = (code & STRAIGHT) != 0
            if near_enough and linear:
                return SEEN, straight
            if wp.static(textured and careful):
                if near_enough and fine:
                    light = demodulated(keys, width, at, (code & WHOLE) != 0, fx, fy, tolerance)
                    if is_demodulated(light):
                        return DEMODULATED, light
            elif wp.static(textured):
                if near_enough and fine and is_demodulated(number(keys.demodulated, at)):
                    return HARD, value
            if near_enough and (code & WHOLE) != 0:
                seen = wp.int32(SEEN)
                value = whole(keys, width, at, weights(fx), weights(fy))
            if near_enough and (code & WHOLE) == 0 and spread <= STEEP * tolerance:
                seen = wp.int32(HARD)
                if wp.static(careful):
                    seen = wp.int32(SEEN)
                    value = masked(keys, width, at, s.patch, w, weights(fx), weights(fy))
            # A step into the black, of many thresholds, must not overshoot by one.
            beyond = pixel(tolerance)
            value = within(value, low - beyond, high + beyond)
            if seen == SEEN and fine and apart(value, straight) > FINE * tolerance:
                seen = wp.int32(HIDDEN)
        else:
            p = whole_pair(keys.patch, at)
            q = whole_pair(keys.patch, below)
            if p[0] == s.patch or p[1] == s.patch or q[0] == s.patch or q[1] == s.patch:
                seen = wp.int32(HARD)
                if wp.static(careful):
                    seen, value = edge(keys, width, at, s.patch, w, fx, fy, tolerance)
        return seen, value

    @wp.func
    def look_up(
        view: CameraView, keys: Keyframes, base: int, s: VisiblePoint, m: wp.vec3, tolerance: float, apart: float
    ):
        """Gives (state, log radiance) of the point in a keyframe, m away from where it is in its camera frame. base:
        index of the first pixel of the keyframe's environment. State: SEEN, HIDDEN, or HARD where only a careful look
        would tell."""
        seen = wp.int32(HIDDEN)
        value = pixel(0.0)
        if m[0] == 0.0 and m[1] == 0.0 and m[2] == 0.0:
            seen, value = where_it_was(keys, s, base + s.y * view.width + s.x)
        else:
            v = displacement(view, s.d, s.point, m, wp.where(s.sky == 1, SKY_NEAR, view.near))
            left = wp.floor(v[0])
            top = wp.floor(v[1])
            if wp.abs(left) < FAR_AWAY and wp.abs(top) < FAR_AWAY:
                x = s.x + int(left)
                y = s.y + int(top)
                if x >= 1 and y >= 1 and x + 2 < view.width and y + 2 < view.height:
                    w = nearness(s, s.point + m)
                    at = base + y * view.width + x
                    fine = wp.bool(False)
                    if wp.static(detailed):
                        # What moves by more than a pixel per frame has events that are further off for that reason.
                        fine = wp.dot(v, v) <= apart * apart
                    seen, value = about(view, keys, s, at, v[0] - left, v[1] - top, w, tolerance, fine)
        return seen, value

    return look_up
