"""Holds the parameters of a sensor in its kernels and what they count, and computes the level L = ln(I + I_dark) of an
intensity.

What decides about an event is computed in float64 from float32 intensities and whole numbers of thresholds; no float is
carried from step to step, so nothing drifts and the result does not depend on how frames are cut into messages.

Inner loops are `while`: Warp's `range` costs 1.5 ns per turn on a CPU, a `while` 0.1 ns.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

TOLERANCE = wp.constant(wp.float64(2.0**-21))
"""A crossing missed by less than this in ln I counts as reached: what four roundings of a float32 luminance come to,
for interpolated light is off by up to three. A square wave begins at one of its two values, so that each return to it
ends exactly at a threshold."""
GUARD = wp.constant(1.0e-5)
"""Relative width by which the inactive range is narrowed, above all float32 errors in it (exp of |L| < 90: 8e-6)."""
LARGEST = wp.constant(3.4028235e38)
SMALLEST = wp.constant(1.1754944e-38)
COUNTERS = ("events", "nonfinite", "clipped", "dropped", "unknown_slopes")
"""What the kernels count, in this order."""
EVENTS = wp.constant(0)
NONFINITE = wp.constant(1)
CLIPPED = wp.constant(2)
DROPPED = wp.constant(3)
UNKNOWN_SLOPES = wp.constant(4)
LEFT = wp.constant(len(COUNTERS))
"""Beyond the counters: 1 + the first pixel that found no room for its events, or 0."""


@wp.struct
class Sensor:
    """Holds the parameters of a sensor for kernels; a field with a parameter's name has its value.

    Thresholds in ln I; dark_level, floor, shot_white in radiance units; rates in Hz; the shifts lay out a key.
    """

    threshold_on: wp.float64
    threshold_off: wp.float64
    gain_on: wp.float32  # exp(threshold_on)
    gain_off: wp.float32  # exp(-threshold_off)
    dark_level: wp.float64
    floor: wp.float32  # least value of I + dark
    height: wp.int32
    width: wp.int32
    channels: wp.int32
    capacity: wp.int64
    shift_x: wp.int64
    shift_y: wp.int64
    shift_t: wp.int64
    shift_env: wp.int64
    seed: wp.int64
    refractory_ns: wp.int64  # refractory period
    shot_rate: wp.float64
    shot_white: wp.float64  # intensity at which shot noise ends
    shot_on_share: wp.float64  # of shot noise
    event_cap: wp.int32  # events per pixel and step


@wp.func
def with_dark_current(intensity: wp.float32, dark_level: wp.float64, floor: wp.float64):
    """Computes I + I_dark, of which a pixel takes the logarithm, or the floor if that is more."""
    return wp.max(wp.float64(intensity) + dark_level, floor)


@wp.func
def light_seen(sensor: Sensor, intensity: wp.float32):
    """Computes `with_dark_current` of a sensor."""
    return with_dark_current(intensity, sensor.dark_level, wp.float64(sensor.floor))


@wp.func
def has_logarithm(intensity: wp.float32, dark_level: wp.float64):
    """Tells whether ln(I + I_dark) is finite: finite light, not negative, and not 0 without dark current; false for
    NaN."""
    return intensity >= 0.0 and intensity <= LARGEST and wp.float64(intensity) + dark_level > wp.float64(0.0)


@wp.func
def log_level(sensor: Sensor, intensity: wp.float32):
    """Computes L = ln(I + I_dark), equation (3), of light that is not below the floor.

    ln is that of the device's library here, the fastest for one pixel. Two more texts of it give other last bits, and
    each has to stay: log_of in cpu/logarithm.h, because a compiler cannot make vector code of a call to a library; and
    ln_as_prescribed in model/paper_kernels.py, because only operations whose rounding is prescribed give a GPU the bits
    of a CPU. They differ by less than 4 units in the last place, 1e-13 at most, and TOLERANCE is 5e-7.
    """
    return wp.log(light_seen(sensor, intensity))


@wp.func
def has_level(sensor: Sensor, intensity: wp.float32):
    """Tells whether a sample has a level L; see `has_logarithm`."""
    return has_logarithm(intensity, sensor.dark_level)


@wp.func
def count_clipped(sensor: Sensor, intensity: wp.float32, counters: wp.array(dtype=wp.int64)):
    """Counts a sample whose light is below the floor."""
    if wp.float64(intensity) + sensor.dark_level < wp.float64(sensor.floor):
        wp.atomic_add(counters, CLIPPED, wp.int64(1))
