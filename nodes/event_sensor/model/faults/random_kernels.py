"""Names the streams of a sensor's random numbers, and draws waiting times from them.

A stream is named by seed + environment, pixel and episode, so that it is the same in any batch, on any device, for any
packet or step.
"""

import warp as wp

from evis.random_number_kernels import GOLDEN, mix, uniform

wp.set_module_options({"enable_backward": False})

NEVER = wp.constant(wp.int64(0x7FFFFFFFFFFFFFFF))
PHASE = wp.constant(wp.int64(-1))
"""The draw that is the phase of a pixel's leak; those from 0 on are the noise's."""
LONGEST = wp.constant(wp.float64(4.0e18))
"""Longest waiting time [ns], so that a stamp of up to 2^62 ns and a wait add up without overflow."""


@wp.func
def stream_of(seed: wp.int64, pixel: wp.int32, episode: wp.int32):
    """Returns the stream of a pixel in an episode; seed is that of the environment."""
    s = mix(wp.uint64(seed) + GOLDEN)
    s = mix(s ^ (wp.uint64(pixel) * GOLDEN + wp.uint64(1)))
    return mix(s ^ (wp.uint64(episode) * GOLDEN + wp.uint64(2)))


@wp.func
def waiting_time(bits: wp.uint64, rate: wp.float64):
    """Draws the waiting time [ns, at least 1] of a Poisson process of this rate [Hz]; rate > 0."""
    wait = -wp.log(wp.float64(1.0) - uniform(bits)) / rate * wp.float64(1.0e9)
    return wp.int64(wp.clamp(wait + wp.float64(0.5), wp.float64(1.0), LONGEST))
