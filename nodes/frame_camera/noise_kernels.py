"""Draws the noise of an image: Poisson electrons and the readout's normal noise, by counting.

A draw is keyed by the environment's stream, the pixel and the number of the image; see
nodes.event_sensor.model.faults.random_kernels.
"""

import math

import warp as wp

from evis.random_number_kernels import GOLDEN, draw, mix, uniform

wp.set_module_options({"enable_backward": False})

DRAWS = wp.constant(wp.int64(4))
"""Numbers that a pixel may draw for one image: two make two normal numbers, one counts electrons."""
COUNTED = wp.constant(wp.float64(64.0))
"""Mean from which on a Poisson number is made of a normal one."""
TWO_PI = wp.constant(wp.float64(2.0 * math.pi))


@wp.func
def stream_of_pixel(seed: wp.uint64, pixel: wp.int32):
    """Returns the stream of a pixel; seed is that of the environment's images."""
    return mix(seed ^ (wp.uint64(pixel) * GOLDEN + wp.uint64(1)))


@wp.func
def two_normals(stream: wp.uint64, number: wp.int64):
    """Draws the two independent standard normal numbers of an image (Box and Muller, 1958)."""
    n = number * DRAWS
    radius = wp.sqrt(wp.float64(-2.0) * wp.log(wp.float64(1.0) - uniform(draw(stream, n))))
    angle = TWO_PI * uniform(draw(stream, n + wp.int64(1)))
    return wp.vec2d(radius * wp.cos(angle), radius * wp.sin(angle))


@wp.func
def electrons_of(mean: wp.float64, z: wp.float64, stream: wp.uint64, number: wp.int64):
    """Draws a Poisson number of this mean: by inversion where it is small; above, by the Cornish-Fisher expansion of
    its quantile in the normal number z, rounded: mean and variance are exact to O(1/mean), and so is the skewness.
    """
    if mean < COUNTED:
        u = uniform(draw(stream, number * DRAWS + wp.int64(2)))
        p = wp.exp(-mean)
        below = p
        count = wp.float64(0.0)
        while u >= below and p > wp.float64(1.0e-300) and count < wp.float64(1000.0):
            count += wp.float64(1.0)
            p *= mean / count
            below += p
        return count
    # Rounding adds a variance of 1/12.
    deviation = wp.sqrt(mean - wp.float64(1.0 / 12.0))
    skew = (z * z - wp.float64(1.0)) / wp.float64(6.0)
    kurtosis = (z - z * z * z) / (wp.float64(72.0) * deviation)
    return wp.max(wp.floor(mean + deviation * z + skew + kurtosis + wp.float64(0.5)), wp.float64(0.0))
