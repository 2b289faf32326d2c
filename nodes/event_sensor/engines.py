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

from nodes.event_sensor import kernels, kernels_paper, noise
from nodes.event_sensor.kernels_quiet import Quiet, arrays_of, quiet_state, runs_of
from nodes.event_sensor.kernels_state import Cold, Features
from nodes.event_sensor.kernels_threads import full_kernels
from nodes.event_sensor.packet import KeyLayout
from nodes.event_sensor.plain import Plain

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


class Full:
    """Curves and faults."""

    sorts = False

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        total = size.envs * size.pixels
        features = features_of(p)
        self._kernel = full_kernels(features)[device.is_cuda]
        self._size, self._device, self.in_place = size, device, not device.is_cuda

        def state() -> tuple[Quiet, wp.array]:
            side: wp.array = wp.zeros(0 if self.in_place else total, dtype=wp.int32, device=device)
            return quiet_state(total, features.timed, features.curved, device), side

        self._before = state()
        self._after = self._before if self.in_place else state()
        self._loud: wp.array = wp.zeros(size.width * size.channels + 1, dtype=wp.int32, device=device)
        struct: Any = Cold
        colds: Any = np.zeros((1 if self.in_place else 2, total), struct.numpy_dtype())
        for name, values in zip(("c_on", "c_off", "leak", "hot"), pattern_of(size, seed, p)):
            if values.size:
                colds[name] = values.reshape(-1)
        self._colds: wp.array = wp.array(colds, dtype=Cold, device=device)

    def arrays(self) -> tuple[wp.array, ...]:
        """Everything that is kept per pixel."""
        states = (self._before,) if self.in_place else (self._before, self._after)
        kept = (a for quiet, side in states for a in (*arrays_of(quiet), side))
        return *kept, self._colds

    def launch(self, sensor: kernels.Sensor, batch: Batch, keys: wp.array, counters: wp.array, resume: int) -> None:
        """Events of a batch to `keys`, as many as fit. In place: from pixel resume - 1 to the first without room."""
        b = batch
        steps = [b.frames, b.count, b.t, b.t_base, b.t_before]
        if self.in_place:
            frames = [b.images, runs_of(b.images), b.slopes, runs_of(b.slopes)]
            inputs = [sensor, b.begin, b.episodes, *frames, *steps, resume]
            outputs = [*self._before, self._loud, self._colds, keys, counters]
        else:
            inputs = [sensor, b.begin, b.episodes, b.images, b.slopes, *steps, *self._before]
            outputs = [*self._after, self._colds, keys, counters]
        wp.launch(self._kernel, self._size.threads(not self.in_place), inputs, outputs, device=self._device)

    def swap(self) -> None:
        self._before, self._after = self._after, self._before


class Paper:
    """The paper's equations."""

    sorts = False

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        total = size.envs * size.pixels
        row = size.width * size.channels
        self._columns = 1 if device.is_cuda else row
        self._threads = (size.envs, size.height, row // self._columns)
        self._device, self.in_place = device, False
        pattern = pattern_of(size, seed, p)
        self._pattern: tuple[wp.array, ...] = tuple(wp.array(a, dtype=wp.float32, device=device) for a in pattern)
        self._before: wp.array = wp.zeros(total, dtype=kernels_paper.PaperPixel, device=device)
        self._after: wp.array = wp.zeros(total, dtype=kernels_paper.PaperPixel, device=device)

    def arrays(self) -> tuple[wp.array, ...]:
        """Everything that is kept per pixel."""
        return self._before, self._after, *self._pattern

    def launch(self, sensor: kernels.Sensor, batch: Batch, keys: wp.array, counters: wp.array, resume: int) -> None:
        """Events of a batch to `keys`, as many as fit; all are counted."""
        b = batch
        wp.launch(
            kernels_paper.paper,
            self._threads,
            [sensor, b.begin, b.episodes, b.images, b.t, b.t_base, self._columns, *self._pattern, self._before],
            [self._after, keys, counters],
            device=self._device,
        )

    def swap(self) -> None:
        self._before, self._after = self._after, self._before


def make_engine(size: Size, seed: int, p: Mapping[str, Any], device: Any) -> Any:
    """The engine for resolved parameters: the plain one unless a curve or a fault is asked for."""
    if p["model"] == "evis-paper":
        return Paper(size, seed, p, device)
    if features_of(p) not in (Features("linear"), Features("frame")):
        return Full(size, seed, p, device)
    frame = p["crossing"] == "frame"
    if device.is_cuda:
        from nodes.event_sensor.cuda.plain import PlainPasses

        return PlainPasses(size.envs * size.pixels, size.pixels, frame, device)
    return Plain(size.envs * size.pixels, frame)


def sensor_struct(p: Mapping[str, Any], shape: tuple[int, int, int], layout: KeyLayout, seed: int) -> kernels.Sensor:
    """Resolved parameters for the kernels. shape: height, width, channels."""
    sensor: Any = kernels.Sensor()
    sensor.threshold_on, sensor.threshold_off = p["threshold_on"], p["threshold_off"]
    sensor.gain_on, sensor.gain_off = math.exp(p["threshold_on"]), math.exp(-p["threshold_off"])
    sensor.dark, sensor.floor = p["dark_level"], FLOOR
    sensor.height, sensor.width, sensor.channels = shape
    sensor.shift_x, sensor.shift_y, sensor.shift_t, sensor.shift_env = layout.x, layout.y, layout.t, layout.env
    sensor.seed = seed
    sensor.dead_ns = round(1e3 * p["refractory_us"])
    sensor.shot_rate, sensor.white, sensor.cap = p["shot_rate"], p["shot_white"], p["event_cap"]
    return sensor
