# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""Kernels of the photoreceptor: the exact step of a low pass on log-intensity whose input is linear in time."""

import functools

import warp as wp

wp.set_module_options({"enable_backward": False})

FLOOR = 2.0**-24
"""Least I + I_dark, as in the sensor: the smallest positive half-precision radiance."""
SMALL = wp.constant(wp.float64(0.02))
"""Below this dt / tau the differences in `response` cancel, and their series has the better error (3e-12)."""
SETTLED = wp.constant(wp.float64(2.0**-32))
"""A pixel in constant light nearer to it than this [ln I] has arrived: 1/250 of the rounding of a float32 luminance."""
LARGEST = wp.constant(3.4028235e38)


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
    """(p, q, r, s) of a step of a = dt / tau, for an input that goes linearly from L0 to L1.

    One pole:  y1 += (L0 - y1) p + (L1 - L0) q,  p = 1 - e^-a,  q = 1 - p / a.
    The second: y2 += (y1 - y2) p + (L0 - y1) r + (L1 - L0) s, all old values,  r = p - a e^-a,  s = 1 + e^-a - 2 p / a.
    """
    one = wp.float64(1.0)
    if a < SMALL:
        b = a * a
        p = a - b * (wp.float64(1.0 / 2.0) - a * wp.float64(1.0 / 6.0) + b * wp.float64(1.0 / 24.0))
        p = p + b * b * a * (wp.float64(1.0 / 120.0) - a * wp.float64(1.0 / 720.0))
        q = a * (wp.float64(1.0 / 2.0) - a * wp.float64(1.0 / 6.0))
        q = q + a * b * (wp.float64(1.0 / 24.0) - a * wp.float64(1.0 / 120.0) + b * wp.float64(1.0 / 720.0))
        r = b * (wp.float64(1.0 / 2.0) - a * wp.float64(1.0 / 3.0) + b * wp.float64(1.0 / 8.0))
        r = r - b * b * a * (wp.float64(1.0 / 30.0) - a * wp.float64(1.0 / 144.0))
        s = b * (wp.float64(1.0 / 6.0) - a * wp.float64(1.0 / 12.0) + b * wp.float64(1.0 / 40.0))
        s = s - b * b * a * (wp.float64(1.0 / 180.0) - a * wp.float64(1.0 / 1008.0))
        return wp.vec4d(p, q, r, s)
    decay = wp.exp(-a)
    p = one - decay
    return wp.vec4d(p, one - p / a, p - a * decay, one + decay - wp.float64(2.0) * p / a)


@wp.kernel
def responses(
    # in
    rate: wp.float64,
    seconds: wp.array(dtype=wp.float64),
    # out
    steps: wp.array(dtype=wp.vec4d),
):
    """The response of each step where all pixels have the same time constant."""
    k = wp.tid()
    steps[k] = response(rate * seconds[k])


@wp.func
def log_level(receptor: Receptor, intensity: wp.float32):
    """L = ln(I + I_dark), from the floor up."""
    return wp.log(wp.max(wp.float64(intensity) + receptor.dark, receptor.floor))


@wp.func
def corner(receptor: Receptor, intensity: wp.float32):
    """1 / tau [1/s]."""
    return receptor.rate * wp.min(wp.float64(1.0), (wp.float64(intensity) + receptor.dark) / receptor.level)


@functools.cache
def low_pass(poles: int, varying: bool) -> wp.Kernel:
    """The filter with one pole or two, with a corner that follows the intensity (`varying`) or not."""
    two = poles == 2

    @wp.kernel(module="unique", enable_backward=False)
    def filter_pixels(
        # in
        receptor: Receptor,
        fresh: wp.array(dtype=wp.int32),
        seconds: wp.array(dtype=wp.float64),
        steps: wp.array(dtype=wp.vec4d),
        luminance: wp.array(dtype=wp.float32),
        # in and out: last good sample (-1: none yet), poles in ln I (first infinite: both rest at the last sample)
        last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64),
        # out
        filtered: wp.array(dtype=wp.float32),
    ):
        env, chunk = wp.tid()
        count = seconds.shape[0]
        i = chunk * receptor.run
        end = wp.min(i + receptor.run, receptor.size)
        while i < end:
            index = env * receptor.size + i
            at = wp.int64(env) * wp.int64(count) * wp.int64(receptor.size) + wp.int64(i)
            last = last_sample[index]
            if fresh[env] != 0:
                last = float(-1.0)
            y1 = first_pole[index]
            y2 = wp.float64(0.0)
            if wp.static(two):
                y2 = second_pole[index]
            l_last = wp.float64(0.0)
            known = bool(False)
            k = int(0)
            while k < count:
                v = luminance[at]
                good = v >= 0.0 and v <= LARGEST
                out = float(wp.nan)
                if last < 0.0:
                    if good:
                        last = v
                        y1 = wp.float64(wp.inf)
                        out = v
                elif (v == last or not good) and y1 == wp.float64(wp.inf):
                    if good:
                        out = v
                else:
                    # A bad sample holds the input at the last good one; time goes on.
                    if not good:
                        v = last
                    l0 = l_last
                    if not known:
                        l0 = log_level(receptor, last)
                    l1 = l0
                    if v != last:
                        l1 = log_level(receptor, v)
                    if y1 == wp.float64(wp.inf):
                        y1 = l0
                        y2 = l0
                    if wp.static(varying):
                        mean = wp.float64(0.5) * (corner(receptor, last) + corner(receptor, v))
                        step = response(mean * seconds[k])
                    else:
                        step = steps[k]
                    if wp.static(two):
                        y2 = y2 + (y1 - y2) * step[0] + (l0 - y1) * step[2] + (l1 - l0) * step[3]
                    y1 = y1 + (l0 - y1) * step[0] + (l1 - l0) * step[1]
                    y = y1
                    arrived = v == last and wp.abs(l1 - y1) < SETTLED
                    if wp.static(two):
                        y = y2
                        arrived = arrived and wp.abs(l1 - y2) < SETTLED
                    if arrived:
                        y1 = wp.float64(wp.inf)
                    if good:
                        if arrived:
                            out = v
                        else:
                            out = wp.clamp(wp.float32(wp.exp(y) - receptor.dark), 0.0, LARGEST)
                    last = v
                    l_last = l1
                    known = bool(True)
                filtered[at] = out
                at += wp.int64(receptor.size)
                k += 1
            last_sample[index] = last
            first_pole[index] = y1
            if wp.static(two):
                second_pole[index] = y2
            i += 1

    return filter_pixels
