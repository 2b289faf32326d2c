"""Applies the refractory period: after an event a pixel is held in reset, and so blind, until its dead time ends.

Its reference is then what it sees at that time.
"""

import warp as wp

from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})


@wp.func
def refractory_end(sensor: Sensor, fired_at: wp.int64):
    """Computes when the refractory period of a pixel that fired at this time ends [ns]."""
    return fired_at + sensor.refractory_ns


@wp.func
def refractory_beyond(refractory_until: wp.int64, now: wp.int64):
    """Tells whether a pixel whose refractory period ends at a time is still blind just after `now` [ns]."""
    return refractory_until > now
