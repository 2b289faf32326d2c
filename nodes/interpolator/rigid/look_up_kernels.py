"""A surface point looked up in a keyframe: where it is there, whether it is seen, and its log radiance."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.distortion_kernels import angle_of, make_distorted
from nodes.renderer.kernels import View

wp.set_module_options({"enable_backward": False})

SAME_POINT = wp.constant(3.0e-3)
"""Difference of inverse distances, of the inverse distance, up to which a keyframe shows the point that is looked for
and not one before or behind it on the same patch."""
SAME_SHEET = wp.constant(3.0e-2)
"""The same, for the pixels about it: a surface seen at a slant is as much nearer from one to the next."""
STEEP = wp.constant(3.0)
"""Differences of log radiance, in tolerances, between neighbours beside which a patch must be seen in full."""
ENOUGH = wp.constant(5)
"""Pixels about a place, of 16, that tell how even a patch is there."""
HIDDEN = wp.constant(0)
SEEN = wp.constant(1)
HARD = wp.constant(2)
FAR_AWAY = wp.constant(1.0e6)
"""Displacement [px] of what a keyframe's camera cannot see."""
BLACK = wp.constant(-69.0)
"""Log radiance up to which a pixel has no light at all: black is kept as ln 1e-30, and is 0 again in the frames."""


@wp.func
def weights(f: float):
    """Cubic convolution (Keys 1981, a = -1/2) at the fraction f between the middle two of four samples."""
    return wp.vec4(
        ((1.0 - 0.5 * f) * f - 0.5) * f,
        (1.5 * f - 2.5) * f * f + 1.0,
        ((2.0 - 1.5 * f) * f + 0.5) * f,
        (0.5 * f - 0.5) * f * f,
    )


SIX = wp.types.vector(length=6, dtype=wp.float32)
"""Log radiance in RGB under the lights at their mean, then without those that flicker."""


@wp.func
def light(value: float):
    """Radiance of a logarithm."""
    return wp.where(value <= BLACK, 0.0, wp.exp(value))


@wp.func
def radiance_of(value: wp.float32, strength: float):
    return light(value)


@wp.func
def radiance_of(value: wp.vec3, strength: float):  # noqa: F811 - overloaded by its type
    return wp.vec3(light(value[0]), light(value[1]), light(value[2]))


@wp.func
def lit(mean: float, steady: float, strength: float):
    """Radiance from its logarithms with the lights at their mean and without those that flicker."""
    rest = light(steady)
    return rest + strength * wp.max(light(mean) - rest, 0.0)


@wp.func
def radiance_of(value: wp.vec2, strength: float):  # noqa: F811 - overloaded by its type
    return lit(value[0], value[1], strength)


@wp.func
def radiance_of(value: SIX, strength: float):  # noqa: F811 - overloaded by its type
    return wp.vec3(
        lit(value[0], value[3], strength), lit(value[1], value[4], strength), lit(value[2], value[5], strength)
    )


@wp.func
def apart(a: wp.float32, b: wp.float32):
    return wp.abs(a - b)


@wp.func
def apart(a: wp.vec3, b: wp.vec3):  # noqa: F811 - overloaded by its type
    return wp.max(wp.abs(a - b))


@wp.func
def apart(a: wp.vec2, b: wp.vec2):  # noqa: F811 - overloaded by its type
    return wp.max(wp.abs(a - b))


@wp.func
def apart(a: SIX, b: SIX):  # noqa: F811 - overloaded by its type
    return wp.max(wp.abs(a - b))


@wp.func
def half_black(low: wp.float32, high: wp.float32):
    """Whether pixels from `low` to `high` are black in part: between ln 0 and ln I is nothing to be looked up."""
    return low <= BLACK and high > BLACK


@wp.func
def half_black(low: Any, high: Any):  # noqa: F811 - overloaded by its type
    result = wp.bool(False)
    for i in range(len(low)):
        result = result or (low[i] <= BLACK and high[i] > BLACK)
    return result


@wp.func
def least(a: Any, b: Any):
    return wp.min(a, b)


@wp.func
def most(a: Any, b: Any):
    return wp.max(a, b)


@wp.func
def within(value: Any, low: Any, high: Any):
    return wp.min(wp.max(value, low), high)


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
    """A pixel's patch (its bits), inverse distance and, in luminance, log radiance, read at once."""
    ...


@wp.func
def shows(t: wp.vec4, p: int, w: float):
    """Whether a pixel shows patch p at about the inverse distance w."""
    return wp.cast(t[0], wp.int32) == p and wp.abs(t[1] - w) <= SAME_SHEET * w


LOGS: dict[tuple[int, bool], Any] = {(1, False): wp.float32, (3, False): wp.vec3, (1, True): wp.vec2, (3, True): SIX}
"""What is looked up, by the number of channels and whether lights flicker: log radiance under the lights as they are,
or both of `lit`'s."""


@cache
def make_look_up(lens: str, channels: int, careful: bool, flicker: bool = False) -> wp.Function:
    """lens: `none` or a distortion model. channels: 1 (luminance) or 3 (RGB). careful: also where a patch is not seen
    in full. flicker: as of LOGS."""
    bent = lens != "none"
    distorted = make_distorted(lens) if bent else None
    pixel = LOGS[channels, flicker]

    @wp.func
    def displacement(view: View, d: wp.vec3, p: wp.vec3, m: wp.vec3, near: float):
        """Pixels from where the point p on ray d is to where p + m is; FAR_AWAY where the camera has no image of it."""
        v = wp.vec2(FAR_AWAY, FAR_AWAY)
        if wp.static(bent):
            q = wp.vec3d(p) + wp.vec3d(m)
            if angle_of(q) < wp.float64(view.domain) and wp.length(q) >= wp.float64(near):
                v = wp.vec2(distorted(view, q) - distorted(view, wp.vec3d(p)))
        else:
            q_z = p[2] + m[2]
            if q_z >= near:
                v = wp.vec2(view.fx * (m[0] - d[0] * m[2]) / q_z, view.fy * (m[1] - d[1] * m[2]) / q_z)
        return v

    @wp.func
    def cubic_row(logs: wp.array(dtype=pixel), at: int, w: wp.vec4):
        return w[0] * logs[at - 1] + w[1] * logs[at] + w[2] * logs[at + 1] + w[3] * logs[at + 2]

    @wp.func
    def log_of(t: wp.vec4, at: int, logs: wp.array(dtype=pixel)):
        """Log radiance of a pixel, from its texel where that holds it."""
        if wp.static(pixel is wp.float32):
            return t[2]
        else:
            return logs[at]

    @wp.func
    def masked_row(
        row: int,
        core: int,
        p: int,
        w: float,
        wx: wp.vec4,
        texels: wp.array(dtype=wp.vec4),
        logs: wp.array(dtype=pixel),
    ):
        """A row of `masked`; core: the nearest row of the middle."""
        # All are read before any is used, for a GPU waits once then.
        t0 = texel(texels, row - 1)
        t1 = texel(texels, row)
        t2 = texel(texels, row + 1)
        t3 = texel(texels, row + 2)
        a = log_of(t1, row, logs)
        b = log_of(t2, row + 1, logs)
        if not shows(t1, p, w):
            a = logs[core]
        if not shows(t2, p, w):
            b = logs[core + 1]
        far_left = a
        far_right = b
        if shows(t0, p, w):
            far_left = log_of(t0, row - 1, logs)
        if shows(t3, p, w):
            far_right = log_of(t3, row + 2, logs)
        return wx[0] * far_left + wx[1] * a + wx[2] * b + wx[3] * far_right

    @wp.func
    def masked(
        width: int,
        at: int,
        p: int,
        w: float,
        wx: wp.vec4,
        wy: wp.vec4,
        texels: wp.array(dtype=wp.vec4),
        logs: wp.array(dtype=pixel),
    ):
        """Cubic convolution where only the middle four of the 4 x 4 pixels are sure to belong to the patch: each of the
        others that does not is replaced by the next one of the middle."""
        below = at + width
        value = wy[0] * masked_row(at - width, at, p, w, wx, texels, logs)
        value += wy[1] * masked_row(at, at, p, w, wx, texels, logs)
        value += wy[2] * masked_row(below, below, p, w, wx, texels, logs)
        return value + wy[3] * masked_row(below + width, below, p, w, wx, texels, logs)

    @wp.func
    def edge(
        width: int,
        at: int,
        p: int,
        w: float,
        fx: float,
        fy: float,
        tolerance: float,
        texels: wp.array(dtype=wp.vec4),
        logs: wp.array(dtype=pixel),
    ):
        """(state, log radiance) where not even the middle four all belong to the patch: the bilinear mean of those that
        do, if the patch is so even here, over ENOUGH of the 4 x 4 pixels or more, that it cannot be far off."""
        total = pixel(0.0)
        weight = wp.float32(0.0)
        low = pixel(1.0e30)
        high = pixel(-1.0e30)
        count = wp.int32(0)
        for j in range(4):
            for i in range(4):
                here = at + (j - 1) * width + i - 1
                t = texel(texels, here)
                value = log_of(t, here, logs)
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

    @wp.func
    def look_up(
        view: View,
        base: int,
        y: int,
        x: int,
        p: int,
        sky: bool,
        d: wp.vec3,
        point: wp.vec3,
        m: wp.vec3,
        tolerance: float,
        patch: wp.array(dtype=int),
        support: wp.array(dtype=int),
        inverse: wp.array(dtype=float),
        logs: wp.array(dtype=pixel),
        texels: wp.array(dtype=wp.vec4),
    ):
        """(state, log radiance) of the point in a keyframe, m away from where it is in its camera frame. base: index of
        the environment's first pixel. State: SEEN, HIDDEN, or HARD where only a careful look would tell."""
        seen = wp.int32(HIDDEN)
        value = pixel(0.0)
        if m[0] == 0.0 and m[1] == 0.0 and m[2] == 0.0:
            # Where it was: this very pixel, if nothing hid it.
            at = base + y * view.width + x
            if patch[at] == p:
                w = wp.float32(0.0)
                if not sky:
                    w = 1.0 / wp.where(wp.static(bent), wp.length(point), point[2])
                if wp.abs(inverse[at] - w) <= SAME_POINT * w:
                    seen = wp.int32(SEEN)
                    value = logs[at]
            return seen, value
        near = wp.where(sky, 1.0e-6, view.near)
        v = displacement(view, d, point, m, near)
        fx = wp.floor(v[0])
        fy = wp.floor(v[1])
        if wp.abs(fx) < 65536.0 and wp.abs(fy) < 65536.0:
            ix = x + int(fx)
            iy = y + int(fy)
            if ix >= 1 and iy >= 1 and ix + 2 < view.width and iy + 2 < view.height:
                at = base + iy * view.width + ix
                code = support[at]
                below = at + view.width
                fx = v[0] - fx
                fy = v[1] - fy
                w = wp.float32(0.0)
                if not sky:
                    q = point + m
                    w = 1.0 / wp.where(wp.static(bent), wp.length(q), q[2])
                if (code >> 1) == p and code >= 0:
                    upper = inverse[at] * (1.0 - fx) + inverse[at + 1] * fx
                    lower = inverse[below] * (1.0 - fx) + inverse[below + 1] * fx
                    low = least(least(logs[at], logs[at + 1]), least(logs[below], logs[below + 1]))
                    high = most(most(logs[at], logs[at + 1]), most(logs[below], logs[below + 1]))
                    near_enough = wp.abs(upper * (1.0 - fy) + lower * fy - w) <= SAME_POINT * w
                    near_enough = near_enough and not half_black(low, high)
                    if near_enough and (code & 1) == 1:
                        seen = wp.int32(SEEN)
                        wx = weights(fx)
                        wy = weights(fy)
                        value = wy[0] * cubic_row(logs, at - view.width, wx) + wy[1] * cubic_row(logs, at, wx)
                        value += wy[2] * cubic_row(logs, below, wx)
                        value += wy[3] * cubic_row(logs, below + view.width, wx)
                    if near_enough and (code & 1) == 0 and apart(low, high) <= STEEP * tolerance:
                        seen = wp.int32(HARD)
                        if wp.static(careful):
                            seen = wp.int32(SEEN)
                            value = masked(view.width, at, p, w, weights(fx), weights(fy), texels, logs)
                    # A step into the black, of many thresholds, must not overshoot by one.
                    beyond = pixel(tolerance)
                    value = within(value, low - beyond, high + beyond)
                elif patch[at] == p or patch[at + 1] == p or patch[below] == p or patch[below + 1] == p:
                    seen = wp.int32(HARD)
                    if wp.static(careful):
                        seen, value = edge(view.width, at, p, w, fx, fy, tolerance, texels, logs)
        return seen, value

    return look_up
