"""Tests whether a step surely makes no event (its curve stays in the inactive range), and updates that range."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.faults.random_kernels import LONGEST, NEVER
from nodes.event_sensor.model.faults.refractory_kernels import refractory_beyond
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.sensor_kernels import LARGEST, Sensor, has_level
from nodes.event_sensor.model.state_kernels import Frequent, Rare
from nodes.event_sensor.model.step_kernels import Levels, PixelParameters, Sample, Step
from nodes.event_sensor.model.threshold_kernels import inactive_range, least_intensity, reference_level

wp.set_module_options({"enable_backward": False})

REST = wp.constant(wp.float64(64.0))
"""Steps that a leaking pixel shall rest for, where the threshold is far enough."""
UNKNOWN = wp.constant(wp.float64(1.0 / 16.0))
"""Of the way to the threshold, left to the leak at an episode's start, where nobody knows how the signal moves."""
THIRD_NS = wp.constant(3.4e-10)
"""A third of a nanosecond [s], 2 % more for rounding: from a sample to its Bezier point a cubic rises by a third of the
step times the slope there [1/s]."""


@lru_cache
def make_curve_inactive(features: Features) -> Any:
    """Makes the function `curve_inactive`."""
    cubic, hermite = features.crossing == "cubic", features.crossing == "hermite"

    @wp.func
    def curve_inactive(sensor: Sensor, frequent: Frequent, sample: Sample, length: wp.int64):
        """Tells whether a step of `length` ns with its samples in the inactive range has its whole curve there."""
        v = sample.light
        slope = sample.slope
        following = sample.following
        dark = wp.float32(sensor.dark_level)
        inside = bool(True)
        if wp.static(cubic):
            # The curve runs over the four samples by a quarter of their range at most: ln(1 + x) <= x.
            a = wp.min(wp.min(v, following), wp.min(frequent.last, frequent.early)) + dark
            b = wp.max(wp.max(v, following), wp.max(frequent.last, frequent.early)) + dark
            inside = inside and frequent.early >= 0.0 and has_level(sensor, following)
            # A ratio, and not a product of two intensities, which float32 has no room for from 1e19 on.
            over = 0.75 + 0.25 * (b / a)
            inside = inside and b * over <= frequent.high + dark
            inside = inside and a >= over * (frequent.low + dark)
        if wp.static(hermite):
            # The curve lies within its Bezier points, a third of the slopes beyond the samples: e^x <= 1 + x + x^2.
            third = wp.max(wp.abs(slope), wp.abs(frequent.early)) * wp.float32(length) * THIRD_NS
            over = 1.0 + third + third * third
            inside = inside and slope == slope and frequent.early == frequent.early and third < 1.0
            inside = inside and (wp.max(v, frequent.last) + dark) * over <= frequent.high + dark
            inside = inside and wp.min(v, frequent.last) + dark >= (frequent.low + dark) * over
        return inside

    return curve_inactive


@lru_cache
def make_update_inactive_range(features: Features) -> Any:
    """Makes the function `update_inactive_range`."""
    leak, noise, refractory = features.leak, features.noise, features.refractory

    @wp.func(inline=True)
    def update_inactive_range(
        sensor: Sensor,
        step: Step,
        own: PixelParameters,
        levels: Levels,
        looked_at: wp.bool,
        state: Rare,
        frequent: Frequent,
    ):
        """Sets the range in which nothing can happen before `wake`, of a pixel that was looked at in a step and has a
        reference."""
        is_refractory = bool(False)
        if wp.static(refractory):
            is_refractory = (
                looked_at and frequent.low <= LARGEST and refractory_beyond(state.refractory_until, step.now)
            )
            if is_refractory:
                frequent.low = least_intensity(sensor)
                frequent.high = LARGEST
                frequent.wake = state.refractory_until
        if looked_at and frequent.low <= LARGEST and not is_refractory:
            zero = wp.float64(0.0)
            reference = reference_level(state.base, state.net, state.n_off, own.c_on, own.c_off)
            reference = reference - own.drift * wp.float64(step.now - state.origin)
            top = reference + own.c_on
            wake = NEVER
            if wp.static(leak):
                gap = top - levels.last
                if own.drift > zero and gap > zero:
                    # Some of the way to the threshold is left to the drift, the rest to the signal: half of it where
                    # the signal rests, as much as the drift does until the signal is there where it moves on.
                    moves = own.drift * wp.float64(step.now - step.start)
                    share = UNKNOWN * gap
                    if moves > zero:
                        share = wp.max(gap * moves / (levels.moved + wp.float64(2.0) * moves), REST * moves)
                        share = wp.min(share, wp.float64(0.5) * gap)
                    wake = step.now + wp.int64(wp.min(share / own.drift, LONGEST))
                    top = top - share
            if wp.static(noise):
                wake = wp.min(wake, state.next_noise)
            limits = inactive_range(sensor, wp.exp(wp.float32(reference - own.c_off)), wp.exp(wp.float32(top)))
            frequent.low = limits[0]
            frequent.high = limits[1]
            frequent.wake = wake
        return frequent

    return update_inactive_range
