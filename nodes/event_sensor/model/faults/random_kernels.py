"""Draws random numbers by counting: a draw is a hash of what it is for, never of what was drawn before.

The hash is SplitMix64 (Steele, Lea, Flood 2014): stream s gives mix(s + n * GOLDEN) as its n-th number. A stream is
named by seed + environment, pixel and episode, so that it is the same in any batch, on any device, for any packet or
step.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

GOLDEN = wp.constant(wp.uint64(0x9E3779B97F4A7C15))
NEVER = wp.constant(wp.int64(0x7FFFFFFFFFFFFFFF))
PHASE = wp.constant(wp.int64(-1))
"""The draw that is the phase of a pixel's leak; those from 0 on are the noise's."""
LONGEST = wp.constant(wp.float64(4.0e18))
"""Longest waiting time [ns], so that a stamp of up to 2^62 ns and a wait add up without overflow."""


@wp.func
def mix(z: wp.uint64):
    """Returns SplitMix64's finalizer; evis.random_numbers has it in numpy."""
    a = (z ^ (z >> wp.uint64(30))) * wp.uint64(0xBF58476D1CE4E5B9)
    b = (a ^ (a >> wp.uint64(27))) * wp.uint64(0x94D049BB133111EB)
    return b ^ (b >> wp.uint64(31))


@wp.func
def stream_of(seed: wp.int64, pixel: wp.int32, episode: wp.int32):
    """Returns the stream of a pixel in an episode; seed is that of the environment."""
    s = mix(wp.uint64(seed) + GOLDEN)
    s = mix(s ^ (wp.uint64(pixel) * GOLDEN + wp.uint64(1)))
    return mix(s ^ (wp.uint64(episode) * GOLDEN + wp.uint64(2)))


@wp.func
def draw(stream: wp.uint64, n: wp.int64):
    """Returns the n-th number of a stream, 64 bits."""
    return mix(stream + (wp.uint64(n) + wp.uint64(1)) * GOLDEN)


@wp.func
def uniform(bits: wp.uint64):
    """Returns a float64 in [0, 1) from the upper 53 bits."""
    return wp.float64(bits >> wp.uint64(11)) * wp.float64(2.0**-53.0)


@wp.func
def waiting_time(bits: wp.uint64, rate: wp.float64):
    """Draws the waiting time [ns, at least 1] of a Poisson process of this rate [Hz]; rate > 0."""
    wait = -wp.log(wp.float64(1.0) - uniform(bits)) / rate * wp.float64(1.0e9)
    return wp.int64(wp.clamp(wait + wp.float64(0.5), wp.float64(1.0), LONGEST))
