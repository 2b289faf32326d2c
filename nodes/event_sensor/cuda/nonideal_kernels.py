"""Senses with curves and faults on a GPU: a thread takes a pixel and channel.

The state before and after a message are two, so that the launch can be made again with more room for events.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.input.between_kernels import Between
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.pixel_kernels import make_sense_pixel
from nodes.event_sensor.model.sensor_kernels import Sensor
from nodes.event_sensor.model.state_kernels import FrequentState, Rare
from nodes.event_sensor.model.step_kernels import message_of, place_of

wp.set_module_options({"enable_backward": False})


@lru_cache
def make_sense_pixels(features: Features) -> Any:
    """Makes the kernel with just these features."""
    sense_pixel = make_sense_pixel(features)

    @wp.kernel(module="unique", enable_backward=False)
    def sense_pixels(
        # in
        sensor: Sensor,
        begin: wp.array(dtype=wp.int32),
        luminance: wp.array(dtype=wp.float32),
        dlog_dt: wp.array(dtype=wp.float32),
        frames: wp.int32,
        count: wp.int32,
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        t_before: wp.int64,
        episodes: wp.array2d(dtype=wp.int32),
        between: Between,
        before: FrequentState,
        side_before: wp.array(dtype=wp.int32),
        # out
        after: FrequentState,
        side_after: wp.array(dtype=wp.int32),
        rare: wp.array2d(dtype=Rare),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Senses a pixel and channel per thread; keys come out in any order and are sorted afterwards.

        Args:
            sensor: its parameters.
            begin: per environment, bits of the frames (0 and 1) at which an episode begins.
            luminance, dlog_dt, frames, count, t, t_base, t_before, episodes, between: see step_kernels.Message.
            before, after: state of every pixel before and after the message.
            side_before, side_after: which of both rows of `rare` is a pixel's, before and after.
            rare: state that few steps need, [2, pixels and channels of all environments].
            keys, counters: the list of events, int64 [capacity], and sensor_kernels.COUNTERS.
        """
        env, y, column = wp.tid()
        message = message_of(luminance, dlog_dt, frames, count, t, t_base, t_before, episodes, between)
        place = place_of(sensor, env, y, column // sensor.channels, column % sensor.channels)
        sense_pixel(
            sensor, place, begin[env], message, before, side_before, after, side_after, rare, keys, counters
        )  # fmt: skip

    return sense_pixels
