"""Counts the thresholds that a pixel's signal has crossed, moves its reference, bounds intensities that cannot fire."""

import warp as wp

from nodes.event_sensor.model.sensor_kernels import GUARD, LARGEST, SMALLEST, TOLERANCE, Sensor

wp.set_module_options({"enable_backward": False})


@wp.func
def reference_level(base: wp.float64, net: wp.int32, n_off: wp.int32, c_on: wp.float64, c_off: wp.float64):
    """Computes a pixel's reference L_ref = base + net C_on + n_off (C_on - C_off).

    net: ON less OFF events since the reference was `base`; n_off: OFF events. Whole numbers of thresholds: L_ref is
    exactly base again when the signal is back, whatever the number of events between.
    """
    return base + wp.float64(net) * c_on + wp.float64(n_off) * (c_on - c_off)


@wp.func
def thresholds_crossed(delta: wp.float64, c_on: wp.float64, c_off: wp.float64, tolerance: wp.float64):
    """Computes n = floor((|L - L_ref| + tolerance) / C), equation (4), and the threshold C with its sign.

    delta: L - L_ref. tolerance: TOLERANCE, or 0 for the equation as it stands.
    """
    up = delta > wp.float64(0.0)
    c = wp.where(up, c_on, c_off)
    n = wp.int32((wp.abs(delta) + tolerance) / c)
    return n, wp.where(up, c, -c)


@wp.func
def first_crossed(delta: wp.float64, c_on: wp.float64, c_off: wp.float64):
    """Computes min(n, 1) of `thresholds_crossed` without its division, for a pixel with a refractory period."""
    up = delta > wp.float64(0.0)
    c = wp.where(up, c_on, c_off)
    n = wp.int32(wp.abs(delta) + TOLERANCE >= c)
    return n, wp.where(up, c, -c)


@wp.func
def least_intensity(sensor: Sensor):
    """Returns the least intensity of an inactive range: 0 must not be in it where it has no logarithm."""
    return wp.where(sensor.dark_level > wp.float64(0.0), wp.float32(0.0), SMALLEST)


@wp.func
def inactive_range(sensor: Sensor, low: wp.float32, high: wp.float32):
    """Computes the intensities that cannot fire: from level exp(L) = low to high, narrowed by float32's errors."""
    dark = wp.float32(sensor.dark_level)
    lowest = low * (1.0 + GUARD)
    # Nothing lies below the floor, so a pixel resting on it is inactive.
    bottom = wp.where(lowest <= sensor.floor, least_intensity(sensor), wp.clamp(lowest - dark, 0.0, LARGEST))
    return wp.vec2f(bottom, wp.min(high * (1.0 - GUARD) - dark, LARGEST))


@wp.func
def range_around(sensor: Sensor, reference: wp.float64):
    """Computes the intensities that surely stay below both thresholds of a reference."""
    level = wp.exp(wp.float32(reference))
    return inactive_range(sensor, level * sensor.gain_off, level * sensor.gain_on)
