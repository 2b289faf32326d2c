# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Reads the samples of a pixel in a message: of frames, of those in which nothing happens, and between frames."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.input.between_kernels import next_sample
from nodes.event_sensor.model.curve_kernels import slope_of
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.sensor_kernels import Sensor
from nodes.event_sensor.model.state_kernels import Frequent
from nodes.event_sensor.model.step_kernels import Message, Place, Sample, Step

wp.set_module_options({"enable_backward": False})


@lru_cache
def make_inactive_frames(features: Features) -> Any:
    """Makes the function `inactive_frames`."""
    timed = features.timed

    @wp.func(inline=True)
    def inactive_frames(message: Message, frequent: Frequent, first: wp.int64, stride: wp.int64):
        """Counts the frames before the first that may do something; returns the last sample of them too.

        first: of the pixel's sample in the first frame; stride: from frame to frame.
        """
        last = frequent.last
        k = int(0)
        while k < message.count:
            sample = message.luminance[first + wp.int64(k) * stride]
            if not (sample >= frequent.low and sample <= frequent.high):
                break
            if wp.static(timed):
                if message.t[k] >= frequent.wake:
                    break
            last = sample
            k += 1
        return k, last

    return inactive_frames


@lru_cache
def make_sample_at(features: Features) -> Any:
    """Makes the function `sample_at`."""
    ahead, hermite = features.ahead, features.crossing == "hermite"

    @wp.func(inline=True)
    def sample_at(
        sensor: Sensor, message: Message, begin: wp.int32, k: wp.int32, first: wp.int64, stride: wp.int64
    ):  # fmt: skip
        """Reads the sample of frame k and, for curves, of the frame after it; first, stride: as of inactive_frames."""
        sample = Sample()
        sample.light = message.luminance[first + wp.int64(k) * stride]
        sample.following = sample.light
        if wp.static(ahead):
            sample.has_next = k + 1 < message.frames and not (k == 0 and (begin & 2) != 0)
            if sample.has_next:
                sample.following = message.luminance[first + wp.int64(k + 1) * stride]
        if wp.static(hermite):
            sample.slope = slope_of(sensor, message.dlog_dt[first + wp.int64(k) * stride], sample.light)
        return sample

    return sample_at


@lru_cache
def make_next_further_sample(features: Features) -> Any:
    """Makes the function `next_further_sample`."""
    further = features.further

    @wp.func(inline=True)
    def next_further_sample(
        # in
        message: Message,
        place: Place,
        entry: wp.int32,
        end: wp.int32,
        # in and out
        step: Step,
        sample: Sample,
    ):
        """Returns True, and the step and the sample at its end, where entry number `entry` of the list is next."""
        found = bool(False)
        if wp.static(further):
            found, now, light = next_sample(
                message.between, place.index, entry, end, step.now - message.t_base, sample.light
            )
            step.now = message.t_base + now
            sample.light = light
        return found, step, sample

    return next_further_sample
