# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""Kernels of the photoreceptor: the exact step of a low pass on log-intensity whose input is linear in time.

What is kept is how far each pole is behind the input, e = y - L. In a step of a = dt / tau in which L grows by dL,

    e1' = e1 d - dL f,   e2' = e2 d + e1 a d + dL (d - 2 f),   d = exp(-a),   f = (1 - d) / a,

so nothing is a difference of nearly equal numbers, and the result I' + dark = (I + dark) exp(e) needs dL = ln of the
ratio of two intensities alone. On a CPU RUN pixels at a time go through series for ln, exp and f, good to 1e-9, while
an intensity changes by less than a factor of two in a step and |e| < 2.5; other pixels take the library's functions.
"""

import functools
import math
from typing import Any

import warp as wp

from nodes.event_sensor.kernels_quiet import RUN, Run

wp.set_module_options({"enable_backward": False})

Lanes = wp.types.vector(length=RUN, dtype=wp.float64)
FLOOR = 2.0**-24
"""Least I + I_dark, as in the sensor: the smallest positive half-precision radiance."""
SMALL = wp.constant(wp.float64(0.02))
"""Below this dt / tau the difference in f cancels, and its series has the better error (1e-14)."""
GRAIN = wp.constant(wp.float64(2.0**-8))
"""e is kept in multiples of 2^-60, so that a pixel in constant light comes to rest."""
LARGEST = wp.constant(3.4028235e38)
STEEPEST = wp.constant(wp.float64(0.35))
"""Of (I1 - I0) / (I1 + I0) for the series of the logarithm: a factor of 2.08."""
FARTHEST = wp.constant(wp.float64(2.5))
"""Of |e| for the series of exp."""
WIDEST = wp.constant(wp.float64(32.0))
"""Of dt / tau for the series of f."""
TERMS = 9
"""Of every series: the first one left out is below 6e-10 of the result."""
Coefficients = wp.types.vector(length=TERMS, dtype=wp.float64)
RATIO = wp.constant(Coefficients(*(2.0 / (2 * k + 1) for k in reversed(range(TERMS)))))
"""ln((1 + z) / (1 - z)) / z, in powers of z^2."""
SHRINKING = wp.constant(Coefficients(*((-1.0) ** k / math.factorial(k + 1) for k in reversed(range(TERMS)))))
"""f = (1 - exp(-x)) / x."""
GROWING = wp.constant(Coefficients(*(1.0 / math.factorial(k + 1) for k in reversed(range(TERMS)))))
"""(exp(x) - 1) / x."""


@wp.struct
class Receptor:
    """rate: 2 pi bandwidth [1/s] at intensities from `level` on. One thread does `run` pixels of `size`."""

    size: wp.int32
    run: wp.int32
    rate: wp.float64
    level: wp.float64
    dark: wp.float64
    floor: wp.float64


@wp.func
def response(a: wp.float64):
    """(d, f) of a step of a = dt / tau."""
    decay = wp.exp(-a)
    f = (wp.float64(1.0) - decay) / wp.max(a, SMALL)
    if a < SMALL:
        f = wp.float64(1.0)
        for k in range(8, 1, -1):
            f = wp.float64(1.0) - a / wp.float64(k) * f
    return wp.vec2d(decay, f)


@wp.kernel
def responses(
    # in
    rate: wp.float64,
    seconds: wp.array(dtype=wp.float64),
    # out
    steps: wp.array(dtype=wp.vec2d),
):
    """The response of each step where all pixels have the same time constant."""
    k = wp.tid()
    steps[k] = response(rate * seconds[k])


@wp.func
def corner(receptor: Receptor, intensity: wp.float32):
    """1 / tau [1/s]."""
    return receptor.rate * wp.min(wp.float64(1.0), (wp.float64(intensity) + receptor.dark) / receptor.level)


@wp.func
def kept(e: wp.float64):
    """e in multiples of 2^-60."""
    return (e + GRAIN) - GRAIN


@functools.cache
def exact_step(poles: int, varying: bool) -> Any:
    """Function: one step of a pixel with the library's functions; returns its output, last sample and both e."""
    two = poles == 2

    @wp.func
    def step(
        receptor: Receptor,
        v: wp.float32,
        last: wp.float32,
        e1: wp.float64,
        e2: wp.float64,
        seconds: wp.float64,
        constant: wp.vec2d,
    ):
        """last: -1 where there is none yet. constant: the response where it is not varying."""
        good = v >= 0.0 and v <= LARGEST
        if last < 0.0:
            if good:
                return v, v, wp.float64(0.0), wp.float64(0.0)
            return float(wp.nan), last, e1, e2
        # A bad sample holds the input at the last good one; time goes on.
        seen = wp.where(good, v, last)
        level = wp.max(wp.float64(seen) + receptor.dark, receptor.floor)
        first = e1
        second = e2
        if seen != last or e1 != wp.float64(0.0) or e2 != wp.float64(0.0):
            grown = wp.float64(0.0)
            if seen != last:
                grown = wp.log(level / wp.max(wp.float64(last) + receptor.dark, receptor.floor))
            a = wp.float64(0.0)
            df = constant
            if wp.static(varying):
                a = wp.float64(0.5) * (corner(receptor, last) + corner(receptor, seen)) * seconds
                df = response(a)
            elif wp.static(two):
                a = receptor.rate * seconds
            if wp.static(two):
                second = kept(e2 * df[0] + e1 * (a * df[0]) + grown * (df[0] - wp.float64(2.0) * df[1]))
            first = kept(e1 * df[0] - grown * df[1])
        y = first
        if wp.static(two):
            y = second
        out = float(wp.nan)
        if good:
            out = v
            if y != wp.float64(0.0):
                out = wp.clamp(wp.float32(level * wp.exp(y) - receptor.dark), 0.0, LARGEST)
        return out, seen, first, second

    return step


@wp.func
def series(coefficients: Coefficients, x: Lanes):
    """The polynomial with these coefficients, highest power first."""
    # Even and odd powers apart, which do not wait for each other.
    square = wp.cw_mul(x, x)
    even = Lanes(coefficients[0])
    odd = Lanes(coefficients[1])
    for k in range(2, wp.static(TERMS), 2):
        even = wp.cw_mul(even, square) + Lanes(coefficients[k])
    for k in range(3, wp.static(TERMS), 2):
        odd = wp.cw_mul(odd, square) + Lanes(coefficients[k])
    return even + wp.cw_mul(odd, x)


@functools.cache
def lanes_step(poles: int, varying: bool) -> Any:
    """Function: one step of RUN pixels by series; returns outputs, both e and a margin, below 0 where it is not good.

    half: rate * seconds / 2 / 2^halvings, so that half * (c0 + c1) is the argument of the series of f.
    """
    two = poles == 2

    @wp.func
    def step(
        receptor: Receptor,
        v: Lanes,
        last: Lanes,
        e1: Lanes,
        e2: Lanes,
        half: wp.float64,
        halvings: wp.int32,
        constant: wp.vec2d,
    ):
        one = Lanes(wp.float64(1.0))
        dark = Lanes(receptor.dark)
        before = last + dark
        level = v + dark
        z = wp.cw_div(level - before, level + before)
        grown = wp.cw_mul(series(RATIO, wp.cw_mul(z, z)), z)
        decay = Lanes(constant[0])
        f = Lanes(constant[1])
        a = wp.float64(2.0) * half * one
        if wp.static(varying):
            inverse = wp.float64(1.0) / receptor.level
            x = half * (wp.min(one, inverse * before) + wp.min(one, inverse * level))
            a = x
            f = series(SHRINKING, x)
            decay = one - wp.cw_mul(x, f)
            i = int(0)
            while i < halvings:
                f = wp.float64(0.5) * wp.cw_mul(f, one + decay)
                decay = wp.cw_mul(decay, decay)
                a = a + a
                i += 1
        grain = Lanes(GRAIN)
        second = e2
        if wp.static(two):
            second = wp.cw_mul(e2, decay) + wp.cw_mul(e1, wp.cw_mul(a, decay))
            second = second + wp.cw_mul(grown, decay - wp.float64(2.0) * f)
            second = (second + grain) - grain
        first = wp.cw_mul(e1, decay) - wp.cw_mul(grown, f)
        first = (first + grain) - grain
        y = first
        if wp.static(two):
            y = second
        x = wp.float64(0.125) * y
        growth = wp.cw_mul(series(GROWING, x), x)
        for _ in range(3):
            growth = wp.cw_mul(growth, growth + wp.float64(2.0) * one)
        out = v + wp.cw_mul(level, growth)
        margin = wp.min(Lanes(STEEPEST) - wp.max(z, -z), Lanes(FARTHEST) - wp.max(y, -y))
        margin = wp.min(wp.min(margin, level - Lanes(receptor.floor)), wp.min(v, last)) + (z - z)
        return wp.max(out, Lanes(wp.float64(0.0))), first, second, wp.max(margin, -one)  # -1 for NaN

    return step


@functools.cache
def low_pass(poles: int, varying: bool) -> wp.Kernel:
    """The filter with one pole or two, with a corner that follows the intensity (`varying`) or not."""
    two = poles == 2
    exact, by_series = exact_step(poles, varying), lanes_step(poles, varying)

    @wp.kernel(module="unique", enable_backward=False)
    def filter_pixels(
        # in
        receptor: Receptor,
        fresh: wp.array(dtype=wp.int32),
        seconds: wp.array(dtype=wp.float64),
        steps: wp.array(dtype=wp.vec2d),
        luminance: wp.array(dtype=wp.float32),
        luminance_runs: wp.array(dtype=Run),
        # in and out: last good sample (-1: none yet), how far the poles are behind it in ln I
        last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64),
        # out
        filtered: wp.array(dtype=wp.float32),
        filtered_runs: wp.array(dtype=Run),
    ):
        env, chunk = wp.tid()
        count = seconds.shape[0]
        i = chunk * receptor.run
        end = wp.min(i + receptor.run, receptor.size)
        index = env * receptor.size + i
        frame = wp.int64(receptor.size)
        at_first = wp.int64(env) * wp.int64(count) * frame + wp.int64(i)
        while i < end:
            lanes = wp.min(end - i, wp.static(RUN))
            # The state of the run, once for all frames.
            last = Lanes()
            e1 = Lanes()
            e2 = Lanes()
            lane = int(0)
            while lane < lanes:
                last[lane] = wp.float64(wp.where(fresh[env] != 0, -1.0, last_sample[index + lane]))
                e1[lane] = first_pole[index + lane]
                if wp.static(two):
                    e2[lane] = second_pole[index + lane]
                lane += 1
            at = at_first
            k = int(0)
            while k < count:
                most = receptor.rate * seconds[k]
                half = wp.float64(0.5) * most
                halvings = int(0)
                if wp.static(varying):
                    while half > wp.float64(0.25):
                        half = wp.float64(0.5) * half
                        halvings += 1
                margin = Lanes(wp.float64(-1.0))
                seen = last
                first = e1
                second = e2
                if lanes == wp.static(RUN) and most < WIDEST:
                    v = Lanes(luminance_runs[at])
                    out, first, second, margin = by_series(receptor, v, last, e1, e2, half, halvings, steps[k])
                    seen = v
                    filtered_runs[at] = Run(out)
                if wp.min(margin) < wp.float64(0.0):
                    lane = int(0)
                    while lane < lanes:
                        if margin[lane] < wp.float64(0.0):
                            here = at + wp.int64(lane)
                            result, good, a1, a2 = exact(
                                receptor, luminance[here], wp.float32(last[lane]), e1[lane], e2[lane], seconds[k],
                                steps[k],
                            )  # fmt: skip
                            filtered[here] = result
                            seen[lane] = wp.float64(good)
                            first[lane] = a1
                            second[lane] = a2
                        lane += 1
                last = seen
                e1 = first
                e2 = second
                at += frame
                k += 1
            lane = int(0)
            while lane < lanes:
                last_sample[index + lane] = wp.float32(last[lane])
                first_pole[index + lane] = e1[lane]
                if wp.static(two):
                    second_pole[index + lane] = e2[lane]
                lane += 1
            i += lanes
            index += lanes
            at_first += wp.int64(lanes)

    return filter_pixels


@functools.cache
def low_pass_gpu(poles: int, varying: bool) -> wp.Kernel:
    """The same with a thread per pixel."""
    two = poles == 2
    exact = exact_step(poles, varying)

    @wp.kernel(module="unique", enable_backward=False)
    def filter_pixel(
        # in
        receptor: Receptor,
        fresh: wp.array(dtype=wp.int32),
        seconds: wp.array(dtype=wp.float64),
        steps: wp.array(dtype=wp.vec2d),
        luminance: wp.array(dtype=wp.float32),
        # in and out: as above
        last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64),
        # out
        filtered: wp.array(dtype=wp.float32),
    ):
        env, i = wp.tid()
        count = seconds.shape[0]
        index = env * receptor.size + i
        at = wp.int64(env) * wp.int64(count) * wp.int64(receptor.size) + wp.int64(i)
        last = last_sample[index]
        if fresh[env] != 0:
            last = float(-1.0)
        e1 = first_pole[index]
        e2 = wp.float64(0.0)
        if wp.static(two):
            e2 = second_pole[index]
        k = int(0)
        while k < count:
            out, seen, first, second = exact(receptor, luminance[at], last, e1, e2, seconds[k], steps[k])
            filtered[at] = out
            last = seen
            e1 = first
            e2 = second
            at += wp.int64(receptor.size)
            k += 1
        last_sample[index] = last
        first_pole[index] = e1
        if wp.static(two):
            second_pole[index] = e2

    return filter_pixel
