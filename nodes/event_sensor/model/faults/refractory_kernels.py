"""Applies the refractory period: after an event a pixel is held in reset, and so blind, until its dead time ends."""

import warp as wp

from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})


@wp.func
def dead_until(sensor: Sensor, fired_at: wp.int64):
    """Computes when the dead time of a pixel that fired at this time ends [ns]."""
    return fired_at + sensor.dead_ns


@wp.func
def dead_beyond(dead: wp.int64, now: wp.int64):
    """Tells whether a pixel whose dead time ends at `dead` is still blind just after `now` [ns]."""
    return dead > now
