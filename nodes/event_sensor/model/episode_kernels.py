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
from nodes.event_sensor.model.state_kernels import ALIVE, NOWHERE, Frequent, Rare
from nodes.event_sensor.model.step_kernels import Levels, Message, Own, Place, Sample, Step

wp.set_module_options({"enable_backward": False})


@lru_cache
def own_parameters(features: Features) -> Any:
    """Makes the function of a pixel's own thresholds, leak and noise."""
    leak, noise, mismatch = features.leak, features.noise, features.mismatch

    @wp.func(inline=True)
    def read_own(
        # in
        sensor: Sensor,
        rare: wp.array2d(dtype=Rare),
        side: wp.int32,
        index: wp.int32,
        wanted: wp.bool,
        # in and out
        state: Rare,
        own: Own,
    ):
        """Reads a pixel's state, if it is wanted, and joins its fixed pattern to the sensor's parameters."""
        if wanted:
            state.base = rare[side, index].base
            state.net = rare[side, index].net
            state.n_off = rare[side, index].n_off
            state.origin = rare[side, index].origin
            state.dead = rare[side, index].dead
            state.next = rare[side, index].next
            state.draws = rare[side, index].draws
            state.c_on = rare[side, index].c_on
            state.c_off = rare[side, index].c_off
            state.leak = rare[side, index].leak
            state.hot = rare[side, index].hot
            own.c_on = sensor.threshold_on
            own.c_off = sensor.threshold_off
            if wp.static(mismatch):
                own.c_on = wp.float64(state.c_on)
                own.c_off = wp.float64(state.c_off)
            if wp.static(leak):
                own.drift = wp.float64(state.leak) * own.c_on * wp.float64(1.0e-9)
            own.rate = sensor.shot_rate
            if wp.static(noise):
                own.rate = own.rate + wp.float64(state.hot)
                own.hot_share = wp.float64(state.hot) / wp.max(own.rate, wp.float64(1.0e-300))
        return state, own

    return read_own


@lru_cache
def episode_start(features: Features) -> Any:
    """Makes the function of a pixel's state after the first good sample of an episode."""
    leak, noise, ahead, hermite = features.leak, features.noise, features.ahead, features.crossing == "hermite"

    @wp.func(inline=True)
    def begin_episode(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        sample: Sample,
        own: Own,
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
            state.dead = ALIVE
            state.next = NEVER
            state.draws = wp.int64(0)
            if wp.static(leak or noise):
                stream = stream_here(sensor, place.env, place.inner, message.episodes, step.k)
                if wp.static(leak):
                    state.origin = leak_origin(stream, state.leak, step.now)
                if wp.static(noise):
                    if own.rate > wp.float64(0.0):
                        state.next = step.now + waiting_time(draw(stream, wp.int64(0)), own.rate)
            levels.earlier = NOWHERE
            levels.early = NOWHERE
            levels.last = state.base
            levels.next = NOWHERE
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
