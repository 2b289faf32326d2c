"""The kernels behind the sensor, their state and how they are launched.

An engine changes its state in place and goes on where the events ran out of room, or it reads the state before a
message and writes the state after it, so that a launch can be made again; `swap` then makes the new state the present
one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.cpu.ideal import Plain
from nodes.event_sensor.model import noise
from nodes.event_sensor.model.pixel_kernels import Sensor
from nodes.event_sensor.model.state_kernels import Features
from nodes.event_sensor.readout.packet import KeyLayout

FLOOR = 2.0**-24
"""Least I + I_dark [radiance]: the smallest positive half-precision radiance. An ideal sensor without dark current
would otherwise answer a black pixel with infinitely many events."""


@dataclass
class Batch:
    """Frames on their way into a kernel. images, slopes: [E, frames, H, W, C]; the first `count` settle now.

    t: int64 [frames]. t_base, t_before: the stamp before t[0] and the one before that. begin: int32 [E], bit k set
    where frame k (0 or 1) begins an episode. episodes: int32 [2, E], of frame 0 and of the later ones. These three are
    of numpy (or rows of it); after `on` they are Warp arrays, and images and slopes are flat.
    """

    images: wp.array
    slopes: wp.array
    t: Any
    frames: int
    count: int
    t_base: int
    t_before: int
    begin: Any
    episodes: Any

    def on(self, device: Any) -> Batch:
        """The same with everything on the device."""

        def there(values: np.ndarray, dtype: Any) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device, copy=False)

        return replace(
            self,
            images=self.images.flatten(),
            slopes=self.slopes.flatten(),
            t=there(self.t, wp.int64),
            begin=there(self.begin.astype(np.int32), wp.int32),
            episodes=there(np.stack(self.episodes), wp.int32),
        )


@dataclass(frozen=True)
class Size:
    """Of all environments."""

    height: int
    width: int
    channels: int
    envs: int

    @property
    def pixels(self) -> int:
        """Of one environment, channels counted."""
        return self.height * self.width * self.channels

    def threads(self, cuda: bool) -> tuple[int, ...]:
        """A thread is a row on a CPU and a pixel and channel on a GPU."""
        return (self.envs, self.height, self.width * self.channels) if cuda else (self.envs, self.height)


def pattern_of(size: Size, seed: int, p: Mapping[str, Any]) -> tuple[np.ndarray, ...]:
    """Fixed pattern of a sensor: ON and OFF thresholds, leak rates, rates as a hot pixel; empty where it has none."""
    envs, pixels = size.envs, size.pixels
    on = off = leaks = hots = np.zeros(0, np.float32)
    if p["threshold_mismatch"] > 0:
        mean = (p["threshold_on"], p["threshold_off"])
        on, off = noise.thresholds(seed, envs, pixels, mean, p["threshold_mismatch"], p["threshold_floor"])
    if p["leak_rate"] > 0:
        leaks = noise.leak_rates(seed, envs, pixels, p["leak_rate"], p["leak_jitter"])
    if p["shot_rate"] > 0 or (p["hot_pixel_rate"] > 0 and p["hot_pixel_fraction"] > 0):
        hots = noise.hot_rates(seed, envs, pixels, p["hot_pixel_fraction"], p["hot_pixel_rate"])
    return on, off, leaks, hots


def features_of(p: Mapping[str, Any]) -> Features:
    """What has to be compiled for these parameters."""
    return Features(
        crossing=p["crossing"],
        leak=p["leak_rate"] > 0 and p["leak_model"] == "drift",
        coin=p["leak_rate"] > 0 and p["leak_model"] == "bernoulli",
        noise=p["shot_rate"] > 0 or (p["hot_pixel_rate"] > 0 and p["hot_pixel_fraction"] > 0),
        refractory=round(1e3 * p["refractory_us"]) > 0,
        mismatch=p["threshold_mismatch"] > 0,
        cap=p["event_cap"] > 0,
    )


def unlit_rate(p: Mapping[str, Any]) -> float:
    """Most events per pixel and second that leak and noise make in constant light, on average; 0: few a frame."""
    if p["model"] != "evis":
        return 0.0
    rate = p["leak_rate"] + p["shot_rate"] + p["hot_pixel_fraction"] * p["hot_pixel_rate"]
    return float(min(rate, 1e6 / p["refractory_us"]) if p["refractory_us"] else rate)


def make_engine(size: Size, seed: int, p: Mapping[str, Any], device: Any) -> Any:
    """The engine for resolved parameters: the plain one unless a curve or a fault is asked for.

    Only what is asked for is imported, for a module of kernels costs some ms.
    """
    if p["model"] == "evis-paper":
        from nodes.event_sensor.model.paper import Paper

        return Paper(size, seed, p, device)
    if features_of(p) not in (Features("linear"), Features("frame")):
        from nodes.event_sensor.model.nonideal import Full

        return Full(size, seed, p, device)
    frame = p["crossing"] == "frame"
    if device.is_cuda:
        from nodes.event_sensor.cuda.ideal import PlainPasses

        return PlainPasses(size.envs * size.pixels, size.pixels, frame, device)
    return Plain(size.envs * size.pixels, frame)


def sensor_struct(p: Mapping[str, Any], shape: tuple[int, int, int], layout: KeyLayout, seed: int) -> Sensor:
    """Resolved parameters for the kernels. shape: height, width, channels."""
    sensor: Any = Sensor()
    sensor.threshold_on, sensor.threshold_off = p["threshold_on"], p["threshold_off"]
    sensor.gain_on, sensor.gain_off = math.exp(p["threshold_on"]), math.exp(-p["threshold_off"])
    sensor.dark, sensor.floor = p["dark_level"], FLOOR
    sensor.height, sensor.width, sensor.channels = shape
    sensor.shift_x, sensor.shift_y, sensor.shift_t, sensor.shift_env = layout.x, layout.y, layout.t, layout.env
    sensor.seed = seed
    sensor.dead_ns = round(1e3 * p["refractory_us"])
    sensor.shot_rate, sensor.white, sensor.cap = p["shot_rate"], p["shot_white"], p["event_cap"]
    return sensor
