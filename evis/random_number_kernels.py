"""Draws random numbers by counting, in kernels: a number is a hash of what it is for, never of what was drawn before.

The hash is SplitMix64, as in evis.random_numbers: stream s gives mix(s + n * GOLDEN) as its n-th number.
"""

import warp as wp

from evis import random_numbers

wp.set_module_options({"enable_backward": False})

GOLDEN = wp.constant(wp.uint64(int(random_numbers.GOLDEN)))
FIRST_FACTOR, SECOND_FACTOR = (wp.constant(wp.uint64(int(factor))) for factor in random_numbers.FACTORS)
"""Of the two rounds of `mix`."""


@wp.func
def mix(z: wp.uint64):
    """Returns SplitMix64's finalizer."""
    a = (z ^ (z >> wp.uint64(30))) * FIRST_FACTOR
    b = (a ^ (a >> wp.uint64(27))) * SECOND_FACTOR
    return b ^ (b >> wp.uint64(31))


@wp.func
def draw(stream: wp.uint64, n: wp.int64):
    """Returns the n-th number of a stream, 64 bits."""
    return mix(stream + (wp.uint64(n) + wp.uint64(1)) * GOLDEN)


@wp.func
def uniform(bits: wp.uint64):
    """Returns a float64 in [0, 1) from the upper 53 bits."""
    return wp.float64(bits >> wp.uint64(11)) * wp.float64(2.0**-53.0)
