"""Initialises a pixel: its fixed pattern when the sensor is made, its state at an episode's first good sample."""

from functools import lru_cache
from typing import Any

import warp as wp

from evis.random_number_kernels import draw
from nodes.event_sensor.model.faults.leak_kernels import leak_origin
from nodes.event_sensor.model.faults.noise_kernels import stream_here
from nodes.event_sensor.model.faults.random_kernels import NEVER, waiting_time
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.sensor_kernels import Sensor, count_clipped, log_level
from nodes.event_sensor.model.state_kernels import NOT_REFRACTORY, UNKNOWN_LEVEL, Frequent, Rare
from nodes.event_sensor.model.step_kernels import Levels, Message, PixelParameters, Place, Sample, Step

wp.set_module_options({"enable_backward": False})


@lru_cache
def make_read_state(features: Features) -> Any:
    """Makes the function `read_state`."""
    leak, noise, mismatch = features.leak, features.noise, features.mismatch

    @wp.func(inline=True)
    def read_state(
        # in
        sensor: Sensor,
        rare: wp.array2d(dtype=Rare),
        side: wp.int32,
        index: wp.int32,
        wanted: wp.bool,
        # in and out
        state: Rare,
        own: PixelParameters,
    ):
        """Reads a pixel's state, if it is wanted, and joins its fixed pattern to the sensor's parameters."""
        if wanted:
            state.base = rare[side, index].base
            state.net = rare[side, index].net
            state.n_off = rare[side, index].n_off
            state.origin = rare[side, index].origin
            state.refractory_until = rare[side, index].refractory_until
            state.next_noise = rare[side, index].next_noise
            state.noise_draws = rare[side, index].noise_draws
            state.c_on = rare[side, index].c_on
            state.c_off = rare[side, index].c_off
            state.leak_rate = rare[side, index].leak_rate
            state.hot_rate = rare[side, index].hot_rate
            own.c_on = sensor.threshold_on
            own.c_off = sensor.threshold_off
            if wp.static(mismatch):
                own.c_on = wp.float64(state.c_on)
                own.c_off = wp.float64(state.c_off)
            if wp.static(leak):
                own.drift = wp.float64(state.leak_rate) * own.c_on * wp.float64(1.0e-9)
            own.rate = sensor.shot_rate
            if wp.static(noise):
                own.rate = own.rate + wp.float64(state.hot_rate)
                own.hot_share = wp.float64(state.hot_rate) / wp.max(own.rate, wp.float64(1.0e-300))
        return state, own

    return read_state


@lru_cache
def make_begin_episode(features: Features) -> Any:
    """Makes the function `begin_episode`."""
    leak, noise, ahead, hermite = features.leak, features.noise, features.ahead, features.crossing == "hermite"

    @wp.func(inline=True)
    def begin_episode(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        sample: Sample,
        own: PixelParameters,
        here: wp.bool,
        # in and out
        state: Rare,
        frequent: Frequent,
        levels: Levels,
        # out
        counters: wp.array(dtype=wp.int64),
    ):
        """Sets the reference, if the episode begins here, to L of the sample; leak and noise begin anew."""
        if here:
            count_clipped(sensor, sample.light, counters)
            state.base = log_level(sensor, sample.light)
            state.net = 0
            state.n_off = 0
            state.origin = step.now
            state.refractory_until = NOT_REFRACTORY
            state.next_noise = NEVER
            state.noise_draws = wp.int64(0)
            if wp.static(leak or noise):
                stream = stream_here(sensor, place.env, place.inner, message.episodes, step.k)
                if wp.static(leak):
                    state.origin = leak_origin(stream, state.leak_rate, step.now)
                if wp.static(noise):
                    if own.rate > wp.float64(0.0):
                        state.next_noise = step.now + waiting_time(draw(stream, wp.int64(0)), own.rate)
            levels.earlier = UNKNOWN_LEVEL
            levels.early = UNKNOWN_LEVEL
            levels.last = state.base
            levels.next = UNKNOWN_LEVEL
            frequent.last = sample.light
            frequent.low = 0.0
            if wp.static(ahead):
                frequent.early = -1.0
                frequent.earlier = -1.0
            if wp.static(hermite):
                frequent.early = sample.slope
                frequent.earlier = float(wp.nan)
        return state, frequent, levels

    return begin_episode
