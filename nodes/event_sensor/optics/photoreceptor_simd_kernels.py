"""Takes many pixels through one step of the low pass, on a CPU: in C++, sixteen pixels at a time.

The equations are those of nodes.event_sensor.optics.photoreceptor_kernels. ln, exp(x) - 1 and f = (1 - exp(-a)) / a are
polynomials with relative errors below 3e-10. A pixel gives the same wherever it lies in the image: the last ones of a
block are filled up to sixteen.
"""

import math
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp

from evis.native_code import native_code
from nodes.event_sensor.cpu.simd_kernels import CONSTANTS

wp.set_module_options({"enable_backward": False})

BLOCK = 2048
"""Pixels that go through all frames of a call together: their state stays in the nearest cache."""
WIDEST = wp.constant(wp.float64(65536.0))
"""Of dt / tau / 2: exp(-a) is squared from exp(-a / 2^n), n up to 18, which multiplies its rounding by 2^n."""
REACH = wp.constant(wp.float64(0.25))
"""Of dt / tau / 2 without halving: f is a polynomial up to a = 0.5."""

GRAIN = wp.constant(wp.float64(2.0**-8))
"""The poles are kept in multiples of 2^-60 behind the input, so that a pixel in constant light comes to rest."""


@wp.struct
class Receptor:
    """Holds the photoreceptor's parameters. rate: 2 pi bandwidth [1/s] at intensities from `level` on; below, it goes
    with their power `exponent`.

    size: pixels and channels of an environment.
    """

    size: wp.int32
    rate: wp.float64
    level: wp.float64
    exponent: wp.float64
    dark: wp.float64
    floor: wp.float64


STEP = Path(__file__).with_name("photoreceptor_simd.h")
CALL = """
return step_block(receptor, luminance, at, ahead, index, size, half, halvings, constant_d, constant_f,
                  last_sample, first_pole, second_pole, filtered, place, chord, bent);"""
ALONE = """
return step_alone(receptor, sample, index, half, halvings, constant_d, constant_f, last_sample, first_pole,
                  second_pole);"""
PIECE = wp.constant(wp.float64(0.1))
"""Change of ln I along a line over which 1 / tau counts as constant, where it follows the light and is traced."""


CONSTANT, PROPORTIONAL, POWER = range(3)
"""Laws of the corner: the same in any light, proportional to the light, or a power of it."""


def constants(poles: int, law: int, bends: bool) -> dict[str, Any]:
    """Returns the constants that the C++ header of the filter is compiled with."""
    filters = {"TWO": poles == 2, "VARYING": law != CONSTANT, "POWERED": law == POWER, "BENDS": bends}
    return {**CONSTANTS, **filters, "LN2": math.log(2.0), "GRAIN": float(GRAIN), "PIECE": float(PIECE)}


@cache
def make_step_block(poles: int, law: int, bends: bool = False) -> Any:
    """Makes the function of one step of a block of pixels.

    It returns how many samples it lists in `place` and leaves alone: those that are bad, too
    dark for a normal logarithm, or the first of their pixel. bends: it marks pixels in `bent` whose output may lie
    further than `chord` from a line between the samples.
    """

    @wp.func_native(native_code([STEP], CALL, constants(poles, law, bends)))
    def step_block(
        receptor: Receptor, luminance: wp.array(dtype=wp.float32), at: wp.int64, ahead: wp.int64, index: wp.int32,
        size: wp.int32, half: wp.float64, halvings: wp.int32, constant_d: wp.float64, constant_f: wp.float64,
        last_sample: wp.array(dtype=wp.float32), first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64), filtered: wp.array(dtype=wp.float32), place: wp.array(dtype=wp.int32),
        chord: wp.float64, bent: wp.array(dtype=wp.uint8),
    ) -> wp.int32:  # fmt: skip
        """Filters a block of pixels.

        at, index: of the block's first pixel, in the frame and in the state. ahead: how far on the next frame is.
        half: rate * seconds / 2 / 2^halvings, not above REACH. constant_d, constant_f: where the corner is constant.
        """
        ...

    return step_block


@cache
def make_step_alone(poles: int, law: int) -> Any:
    """Makes the function of one step of one pixel, to the bits of step_block."""

    @wp.func_native(native_code([STEP], ALONE, constants(poles, law, False)))
    def step_alone(
        receptor: Receptor, sample: wp.float32, index: wp.int32, half: wp.float64, halvings: wp.int32,
        constant_d: wp.float64, constant_f: wp.float64, last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64), second_pole: wp.array(dtype=wp.float64),
    ) -> wp.float32:  # fmt: skip
        """Moves the pixel's state on, and returns the output; -1 and nothing done where step_block lists the sample."""
        ...

    return step_alone
