# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Computes the ideal sensor's events at samples that every pixel has at times of its own, and counts events without a
partner.

The equations are the sensor's own (nodes.event_sensor.model); only the samples are laid out differently.
"""

import warp as wp

from nodes.event_sensor.model.crossing_kernels import crossing_on_line
from nodes.event_sensor.model.sensor_kernels import TOLERANCE, Sensor, has_level, log_level
from nodes.event_sensor.model.threshold_kernels import reference_level, thresholds_crossed

wp.set_module_options({"enable_backward": False})


@wp.struct
class PixelStates:
    """Holds what a pixel keeps between batches [N]; begun: 0 before its first sample that has a level."""

    begun: wp.array(dtype=wp.int32)
    base: wp.array(dtype=wp.float64)
    net: wp.array(dtype=wp.int32)
    n_off: wp.array(dtype=wp.int32)
    level: wp.array(dtype=wp.float64)
    t: wp.array(dtype=wp.int64)


@wp.kernel
def sense_samples(
    # in
    sensor: Sensor,
    first: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    luminance: wp.array(dtype=wp.float32),
    room: wp.array(dtype=wp.int64),
    write: wp.int32,
    # in and out
    states: PixelStates,
    # out
    count: wp.array(dtype=wp.int64),
    t_out: wp.array(dtype=wp.int64),
    p_out: wp.array(dtype=wp.uint8),
):
    """Counts the events of each pixel, whose samples are [first[n], first[n + 1]); with `write`, writes them.

    They go to [room[n], ...), and only then does the pixel's state change. A sample without a level counts as the one
    before it.
    """
    n = wp.tid()
    begun = states.begun[n]
    base = states.base[n]
    net = states.net[n]
    n_off = states.n_off[n]
    level = states.level[n]
    start = states.t[n]
    c_on = sensor.threshold_on
    c_off = sensor.threshold_off
    made = wp.int64(0)
    k = first[n]
    while k < first[n + 1]:
        v = luminance[k]
        now = t[k]
        usable = has_level(sensor, v)
        if begun == 0:
            if usable:
                begun = 1
                base = log_level(sensor, v)
                level = base
                net = 0
                n_off = 0
        elif usable:
            l1 = log_level(sensor, v)
            span = wp.float64(now - start)
            reference = reference_level(base, net, n_off, c_on, c_off)
            crossed, c = thresholds_crossed(l1 - reference, c_on, c_off, TOLERANCE)
            if crossed > 0:
                slope = span / (l1 - level)
                j = int(0)
                while j < crossed:
                    j += 1
                    if write == 1:
                        at = crossing_on_line(reference + wp.float64(j) * c, level, slope, span)
                        t_out[room[n] + made] = start + at
                        p_out[room[n] + made] = wp.uint8(wp.where(c > wp.float64(0.0), 1, 0))
                    made += wp.int64(1)
                net += wp.where(c > wp.float64(0.0), crossed, -crossed)
                n_off += wp.where(c > wp.float64(0.0), 0, crossed)
            level = l1
        start = now
        k += wp.int64(1)
    count[n] = made
    if write == 1:
        states.begun[n] = begun
        states.base[n] = base
        states.net[n] = net
        states.n_off[n] = n_off
        states.level[n] = level
        states.t[n] = start


@wp.kernel
def count_unpaired(
    # in
    t_a: wp.array(dtype=wp.int64),
    offsets_a: wp.array(dtype=wp.int64),
    t_b: wp.array(dtype=wp.int64),
    offsets_b: wp.array(dtype=wp.int64),
    within: wp.int64,
    # out
    unpaired: wp.array(dtype=wp.int64),
):
    """Counts the events of two trains that are left when as many as possible are paired within a time, one to one."""
    g = wp.tid()
    i = offsets_a[g]
    j = offsets_b[g]
    pairs = wp.int64(0)
    while i < offsets_a[g + 1] and j < offsets_b[g + 1]:
        apart = t_b[j] - t_a[i]
        if wp.abs(apart) <= within:
            pairs += wp.int64(1)
            i += wp.int64(1)
            j += wp.int64(1)
        elif apart > wp.int64(0):
            i += wp.int64(1)
        else:
            j += wp.int64(1)
    total = offsets_a[g + 1] - offsets_a[g] + offsets_b[g + 1] - offsets_b[g]
    unpaired[g] = total - wp.int64(2) * pairs
