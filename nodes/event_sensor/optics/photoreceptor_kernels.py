# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Computes the exact step of a low pass on log-intensity whose input is linear in time.

What is kept is how far each pole is behind the input, e = y - L. In a step of a = dt / tau in which L grows by dL,

    e1' = e1 d - dL f,   e2' = e2 d + e1 a d + dL (d - 2 f),   d = exp(-a),   f = (1 - d) / a,

so nothing is a difference of nearly equal numbers, and the result I' + dark = (I + dark) exp(e) needs dL = ln of the
ratio of two intensities alone. On a CPU photoreceptor_simd_kernels takes the pixels of a block
together, good to 1e-9; samples that it lists go through the library's functions here, as all do on a GPU.
"""

import functools
from typing import Any

import warp as wp

from nodes.event_sensor.model.sensor_kernels import LARGEST, has_logarithm, with_dark_current
from nodes.event_sensor.optics import photoreceptor_simd_kernels as simd
from nodes.event_sensor.optics.photoreceptor_simd_kernels import GRAIN, Receptor

wp.set_module_options({"enable_backward": False})

SMALL = wp.constant(wp.float64(0.02))
"""Below this dt / tau the difference in f cancels, and its series has the better error (1e-14)."""


@wp.func
def response(a: wp.float64):
    """Computes d = exp(-a) and f = (1 - d) / a of a step of a = dt / tau."""
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
    """Computes the response of each step where all pixels have the same time constant."""
    k = wp.tid()
    steps[k] = response(rate * seconds[k])


@functools.cache
def make_corner_share(law: int) -> Any:
    """Makes the function `corner_share`; that of POWER is right for a corner in proportion to the light, too."""
    varying, powered = law != simd.CONSTANT, law == simd.POWER

    @wp.func
    def corner_share(receptor: Receptor, level: wp.float64):
        """Computes the corner at an intensity with its dark current, as a share of the largest."""
        share = wp.float64(1.0)
        if wp.static(varying):
            share = wp.min(share, level / receptor.level)
        if wp.static(powered):
            if receptor.exponent != wp.float64(1.0):
                share = wp.pow(share, receptor.exponent)
        return share

    return corner_share


corner_share_of_any = make_corner_share(simd.POWER)


@wp.func
def corner(receptor: Receptor, intensity: wp.float32):
    """Computes 1 / tau [1/s] at an intensity."""
    return receptor.rate * corner_share_of_any(receptor, wp.float64(intensity) + receptor.dark)


@wp.func
def light_seen(receptor: Receptor, light: wp.float32):
    """Computes `with_dark_current` of a photoreceptor."""
    return with_dark_current(light, receptor.dark, receptor.floor)


@wp.func
def kept(e: wp.float64):
    """Rounds e to multiples of 2^-60."""
    return (e + GRAIN) - GRAIN


@wp.func
def poles_after(
    e1: wp.float64, e2: wp.float64, grown: wp.float64, a: wp.float64, df: wp.vec2d, two: wp.bool
):  # fmt: skip
    """Computes how far the poles are behind after a step of a = dt / tau in which L grows by `grown`.

    df: response(a). two: the second pole is there.
    """
    second = e2
    if two:
        second = kept(e2 * df[0] + e1 * (a * df[0]) + grown * (df[0] - wp.float64(2.0) * df[1]))
    return kept(e1 * df[0] - grown * df[1]), second


@functools.cache
def make_exact_step(poles: int, varying: bool) -> Any:
    """Makes the function of one step of a pixel, with the library's ln and exp."""
    two = poles == 2

    @wp.func
    def exact_step(
        receptor: Receptor,
        v: wp.float32,
        last: wp.float32,
        e1: wp.float64,
        e2: wp.float64,
        seconds: wp.float64,
        constant: wp.vec2d,
    ):
        """Filters one sample; returns the output, the last good sample and both e.

        last: -1 where there is none yet. constant: the response where it is not varying.
        """
        good = has_logarithm(v, receptor.dark)
        if last < 0.0:
            if good:
                return v, v, wp.float64(0.0), wp.float64(0.0)
            return float(wp.nan), last, e1, e2
        # A bad sample holds the input at the last good one; time goes on.
        seen = wp.where(good, v, last)
        level = light_seen(receptor, seen)
        first = e1
        second = e2
        if seen != last or e1 != wp.float64(0.0) or e2 != wp.float64(0.0):
            grown = wp.float64(0.0)
            if seen != last:
                grown = wp.log(level / light_seen(receptor, last))
            a = wp.float64(0.0)
            df = constant
            if wp.static(varying):
                a = wp.float64(0.5) * (corner(receptor, last) + corner(receptor, seen)) * seconds
                df = response(a)
            elif wp.static(two):
                a = receptor.rate * seconds
            first, second = poles_after(e1, e2, grown, a, df, wp.static(two))
        y = first
        if wp.static(two):
            y = second
        out = float(wp.nan)
        if good:
            out = v
            if y != wp.float64(0.0):
                out = wp.clamp(wp.float32(level * wp.exp(y) - receptor.dark), 0.0, LARGEST)
        return out, seen, first, second

    return exact_step


@wp.func
def halved(half: wp.float64):
    """Returns half of a = dt / tau, or a part of it that is within reach of step_block, and how often it was halved."""
    part = half
    count = int(0)
    while part > simd.REACH:
        part = wp.float64(0.5) * part
        count += 1
    return part, count


@functools.cache
def make_filter_blocks(poles: int, law: int, bends: bool = False) -> wp.Kernel:
    """Makes the filter with one pole or two, with a corner of this law, for a CPU.

    bends: pixels are marked whose output may lie further than `chord` from lines between the frames.
    """
    varying = law != simd.CONSTANT
    exact_step, step_block = make_exact_step(poles, varying), simd.make_step_block(poles, law, bends)
    two = poles == 2

    @wp.kernel(module="unique", enable_backward=False)
    def filter_blocks(
        # in
        receptor: Receptor,
        fresh: wp.array(dtype=wp.int32),
        seconds: wp.array(dtype=wp.float64),
        steps: wp.array(dtype=wp.vec2d),
        luminance: wp.array(dtype=wp.float32),
        chord: wp.float64,
        # in and out: last good sample (-1: none yet), how far the poles are behind it in ln I; places in a block
        last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64),
        place: wp.array(dtype=wp.int32),
        # out
        filtered: wp.array(dtype=wp.float32),
        bent: wp.array(dtype=wp.uint8),
    ):
        """Filters a block of pixels per thread, through all frames."""
        env, block = wp.tid()
        count = seconds.shape[0]
        first = block * wp.static(simd.BLOCK)
        size = wp.min(receptor.size - first, wp.static(simd.BLOCK))
        index = env * receptor.size + first
        if fresh[env] != 0:
            i = int(0)
            while i < size:
                last_sample[index + i] = -1.0
                i += 1
        at = wp.int64(env) * wp.int64(count) * wp.int64(receptor.size) + wp.int64(first)
        k = int(0)
        while k < count:
            half = wp.float64(0.5) * receptor.rate * seconds[k]
            halvings = int(0)
            ahead = wp.int64(wp.where(k + 1 < count, receptor.size, 0))
            alone = int(size)  # pixels that are filtered one by one
            together = not (wp.static(varying) and half > simd.WIDEST)
            if together:
                if wp.static(varying):
                    half, halvings = halved(half)
                alone = step_block(
                    receptor, luminance, at, ahead, index, size, half, halvings, steps[k][0], steps[k][1], last_sample,
                    first_pole, second_pole, filtered, place, chord, bent,
                )  # fmt: skip
            j = int(0)
            while j < alone:
                i = j
                if together:
                    i = place[j]
                here = index + i
                if wp.static(bends):
                    bent[here] = wp.uint8(1)
                e2 = wp.float64(0.0)
                if wp.static(two):
                    e2 = second_pole[here]
                out, seen, after1, after2 = exact_step(
                    receptor, luminance[at + wp.int64(i)], last_sample[here], first_pole[here], e2, seconds[k], steps[k]
                )  # fmt: skip
                filtered[at + wp.int64(i)] = out
                last_sample[here] = seen
                first_pole[here] = after1
                if wp.static(two):
                    second_pole[here] = after2
                j += 1
            at += wp.int64(receptor.size)
            k += 1

    return filter_blocks


@functools.cache
def make_filter_pixel(poles: int, varying: bool) -> wp.Kernel:
    """Makes the filter with a thread per pixel, for a GPU."""
    two = poles == 2
    exact_step = make_exact_step(poles, varying)

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
        """Filters a pixel through all frames of a call."""
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
            out, seen, first, second = exact_step(receptor, luminance[at], last, e1, e2, seconds[k], steps[k])
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
