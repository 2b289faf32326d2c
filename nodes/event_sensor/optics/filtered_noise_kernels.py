"""Computes white noise behind one pole or two, from instant to instant: a stationary Gaussian process of unit variance.

With s = dt / tau one pole moves by

    z' = d z + sqrt(1 - d^2) x,   d = exp(-s),

and of two, the second having unit variance and the first u twice that, as of stationary noise through both,

    u' = d u + p x,   z' = d (z + s u) + q x + r y,
    p^2 = 2 (1 - d^2),   p q = 1 - d^2 (1 + 2 s),   q^2 + r^2 = 1 - d^2 (1 + 2 s + 2 s^2),

x, y being standard normal: the exact answer at any step (Uhlenbeck and Ornstein, Phys. Rev. 36, 1930; of two poles the
covariance that P - F P F' leaves, F being the step of the poles and P their covariance). Their autocorrelations are
exp(-s) and (1 + s) exp(-s).
"""

import functools
from typing import Any

import warp as wp

from evis.random_number_kernels import draw

wp.set_module_options({"enable_backward": False})


@wp.struct
class Coefficients:
    """Holds the coefficients of a step, as above."""

    d: wp.float64
    s: wp.float64
    p: wp.float64
    q: wp.float64
    r: wp.float64


@wp.func
def standard_normal(stream: wp.uint64, n: wp.int64):
    """Draws number n of a stream of standard normal numbers, by the inverse of their distribution, good to 1e-7.

    Wichura, algorithm AS 241 (PPND7), Applied Statistics 37(3), 1988: at half the price of Box's and Muller's way.
    """
    one = wp.float64(1.0)
    below = (wp.float64(draw(stream, n) >> wp.uint64(11)) + wp.float64(0.5)) * wp.float64(2.0**-53.0)
    q = below - wp.float64(0.5)
    r = wp.float64(0.180625) - q * q
    x = wp.float64(0.0)
    if r >= wp.float64(0.0):
        top = (wp.float64(5.9109374720e1) * r + wp.float64(1.5929113202e2)) * r + wp.float64(5.0434271938e1)
        bottom = (wp.float64(6.7187563600e1) * r + wp.float64(7.8757757664e1)) * r + wp.float64(1.7895169469e1)
        x = q * (top * r + wp.float64(3.3871327179)) / (bottom * r + one)
    else:
        r = wp.sqrt(-wp.log(wp.min(below, one - below)))
        if r <= wp.float64(5.0):
            r = r - wp.float64(1.6)
            top = (wp.float64(1.7023821103e-1) * r + wp.float64(1.3067284816)) * r + wp.float64(2.7568153900)
            x = (top * r + wp.float64(1.4234372777)) / (
                (wp.float64(1.2021132975e-1) * r + wp.float64(7.3700164250e-1)) * r + one
            )
        else:
            r = r - wp.float64(5.0)
            top = (wp.float64(1.7337203997e-2) * r + wp.float64(4.2868294337e-1)) * r + wp.float64(3.0812263860)
            x = (top * r + wp.float64(6.6579051150)) / (
                (wp.float64(1.2258202635e-2) * r + wp.float64(2.4197894225e-1)) * r + one
            )
        if q < wp.float64(0.0):
            x = -x
    return x


@functools.cache
def make_step_of(poles: int) -> Any:
    """Makes the function of the coefficients of a step."""
    two = poles == 2

    @wp.func
    def step_of(s: wp.float64):
        """Computes the coefficients of a step of s = dt / tau."""
        one = wp.float64(1.0)
        found = Coefficients()
        found.s = s
        found.d = wp.exp(-s)
        left = wp.exp(wp.float64(-2.0) * s)
        found.p = wp.sqrt(one - left)
        if wp.static(two):
            found.p = wp.sqrt(wp.float64(2.0) * (one - left))
            if found.p > wp.float64(0.0):
                found.q = (one - left * (one + wp.float64(2.0) * s)) / found.p
            rest = one - left * (one + wp.float64(2.0) * s * (one + s)) - found.q * found.q
            # Rounding may leave less than nothing of s^3 / 3.
            found.r = wp.sqrt(wp.max(rest, wp.float64(0.0)))
        return found

    return step_of


@functools.cache
def make_stationary(poles: int) -> Any:
    """Makes the function `stationary`."""
    two = poles == 2

    @wp.func
    def stationary(stream: wp.uint64):
        """Draws u and z at the first instant, as of noise that has always been there; u of two poles alone."""
        u = wp.float64(0.0)
        z = standard_normal(stream, wp.int64(0))
        if wp.static(two):
            u = wp.sqrt(wp.float64(2.0)) * z
            z = wp.sqrt(wp.float64(0.5)) * (z + standard_normal(stream, wp.int64(1)))
        return u, z

    return stationary


@functools.cache
def make_next_value(poles: int) -> Any:
    """Makes the function `next_value`."""
    two = poles == 2

    @wp.func(inline=True)
    def next_value(step: Coefficients, stream: wp.uint64, number: wp.int64, u: wp.float64, z: wp.float64):
        """Moves u and z on by a step, to instant `number` of a stream of random numbers; u of two poles alone."""
        first = u
        second = z
        if wp.static(two):
            x = standard_normal(stream, number + number)
            y = standard_normal(stream, number + number + wp.int64(1))
            second = step.d * (z + step.s * u) + step.q * x + step.r * y
            first = step.d * u + step.p * x
        else:
            second = step.d * z + step.p * standard_normal(stream, number)
        return first, second

    return next_value
