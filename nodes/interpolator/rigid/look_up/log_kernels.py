"""Holds log radiance as it is looked up: of luminance or RGB, once or under several lights that flicker."""

from functools import cache
from typing import Any

import warp as wp

from evis.media.colour import REC709
from nodes.interpolator.image_kernels import pixel_type

wp.set_module_options({"enable_backward": False})

BLACK = wp.constant(-69.0)
"""Log radiance up to which a pixel has no light at all: black is kept as ln 1e-30, and is 0 again in the frames."""


@cache
def log_type(channels: int, waveform_count: int) -> Any:
    """Makes the type of what is looked up, a number or a vector.

    channels: 1 (luminance) or 3 (RGB). waveform_count: how many waveforms there are of lights that flicker. Without any
    it is the log radiance under the lights as they are; otherwise, of all channels, that under the steady lights and
    those of each waveform at their mean, and at last that under the steady lights alone.
    """
    if waveform_count == 0:
        return pixel_type(channels)
    return wp.types.vector(length=channels * (waveform_count + 1), dtype=wp.float32)


def name_of(kind: str, channels: int, waveform_count: int) -> str:
    """Gives a name to a struct of what is looked up, for two of one name must not differ."""
    return f"{kind}{channels}{f'lit{waveform_count}' if waveform_count else ''}"


RED, GREEN, BLUE = (wp.constant(weight) for weight in REC709)
"""Weights of luminance."""


@wp.func
def fused_luminance(colour: wp.vec3):
    """Computes luminance, equation (3), with products and sums fused where the device does that.

    The renderer's own rounds each operation. Here that would move events on a GPU, by up to 1.4 us where ln I hardly
    changes.
    """
    return RED * colour[0] + GREEN * colour[1] + BLUE * colour[2]


# On a GPU exp x = 2^n exp r with n = rint(x / ln 2) and r = x - n ln 2, in two parts of ln 2 (Cody and Waite, Software
# Manual for the Elementary Functions, 1980): right to 2 units in the last place where a kernel is compiled for fast
# arithmetic too, with which `exp` would be off by |x| times as many.
EXPONENTIAL = """
#if defined(__CUDA_ARCH__)
    const float n = rintf(value * 1.44269504f);
    const float r = fmaf(n, 1.90465430e-9f, fmaf(n, -0.693147182f, value));
    float power;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(power) : "f"(r * 1.44269504f));
    return power * __int_as_float(((int)n + 126) << 23) * 2.0f;
#else
    return wp::exp(value);
#endif
"""


@wp.func_native(EXPONENTIAL)
def exponential(value: wp.float32) -> wp.float32:
    """Computes exp of a logarithm of radiance, from BLACK to that of the largest number."""
    ...


@wp.func
def light(value: wp.float32):
    """Gives the radiance of a logarithm; in RGB of each channel."""
    return wp.where(value <= BLACK, 0.0, exponential(value))


@wp.func
def light(value: wp.vec3):  # noqa: F811 - overloaded by its type
    return wp.vec3(light(value[0]), light(value[1]), light(value[2]))


@cache
def make_radiance_of(channels: int, waveform_count: int) -> wp.Function:
    """Makes the function `radiance_of`; arguments as of `log_type`."""
    value_type: Any = log_type(channels, waveform_count)

    @wp.func
    def channel_of(value: value_type, channel: int, strength: wp.array(dtype=float), row: int):
        """Gives the radiance in one channel under all lights."""
        rest = light(value[wp.static(channels * waveform_count) + channel])
        total = rest
        for way in range(wp.static(waveform_count)):
            mean = light(value[wp.static(channels) * way + channel])
            total += strength[wp.static(waveform_count) * row + way] * wp.max(mean - rest, 0.0)
        return total

    @wp.func
    def radiance_of(value: value_type, strength: wp.array(dtype=float), row: int):
        """Computes the radiance of what was looked up; strength [rows waveforms]: of lights that flicker."""
        if wp.static(waveform_count == 0):
            return light(value)
        elif wp.static(channels == 1):
            return channel_of(value, 0, strength, row)
        else:
            return wp.vec3(
                channel_of(value, 0, strength, row),
                channel_of(value, 1, strength, row),
                channel_of(value, 2, strength, row),
            )

    return radiance_of


@wp.func
def brighter(value: wp.float32, by: float):
    """Adds to a logarithm, but to that of black; in RGB to each channel."""
    return wp.where(value <= BLACK, value, value + by)


@wp.func
def brighter(value: wp.vec3, by: float):  # noqa: F811 - overloaded by its type
    return wp.vec3(brighter(value[0], by), brighter(value[1], by), brighter(value[2], by))


@wp.func
def apart(a: wp.float32, b: wp.float32):
    """Computes the largest difference of two logarithms among their channels."""
    return wp.abs(a - b)


@wp.func
def apart(a: Any, b: Any):  # noqa: F811 - overloaded by its type
    return wp.max(wp.abs(a - b))


@wp.func
def half_black(low: wp.float32, high: wp.float32):
    """Tells whether pixels from `low` to `high` are black in part: between ln 0 and ln I is nothing to be looked up."""
    return low <= BLACK and high > BLACK


@wp.func
def half_black(low: Any, high: Any):  # noqa: F811 - overloaded by its type
    """Tells whether any channel is black in part."""
    result = wp.bool(False)
    for i in range(len(low)):
        result = result or (low[i] <= BLACK and high[i] > BLACK)
    return result


SMALLER = """
#if defined(__CUDA_ARCH__)
    return fminf(a, b);
#else
    return b < a ? b : a;
#endif
"""
LARGER = SMALLER.replace("fminf", "fmaxf").replace("b < a", "a < b")


@wp.func_native(SMALLER)
def smaller(a: wp.float32, b: wp.float32) -> wp.float32:
    """Takes the smaller of two numbers, neither of which is NaN: one instruction, where wp.min has six on a CPU."""
    ...


@wp.func_native(LARGER)
def larger(a: wp.float32, b: wp.float32) -> wp.float32:
    """Takes the larger of two numbers, neither of which is NaN."""
    ...


@wp.func
def least(a: wp.float32, b: wp.float32):
    """Takes the smaller one, channel by channel."""
    return smaller(a, b)


@wp.func
def least(a: Any, b: Any):  # noqa: F811 - overloaded by its type
    return wp.min(a, b)


@wp.func
def most(a: wp.float32, b: wp.float32):
    """Takes the larger one, channel by channel."""
    return larger(a, b)


@wp.func
def most(a: Any, b: Any):  # noqa: F811 - overloaded by its type
    return wp.max(a, b)


@wp.func
def within(value: Any, low: Any, high: Any):
    """Clamps a value, channel by channel."""
    return least(most(value, low), high)
