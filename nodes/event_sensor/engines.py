"""The three kernels behind the sensor, their state and how they are launched.

Every engine reads the state before a message and writes the state after it, so that a launch can be made again with a
longer buffer when the events did not fit. `swap` makes the new state the present one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor import kernels, kernels_full, kernels_paper, noise
from nodes.event_sensor.kernels_full import Features, full_kernels
from nodes.event_sensor.kernels_plain import plain_kernels


@dataclass
class Batch:
    """Frames on their way into a kernel. images, slopes: flat, of [E, frames, H, W, C]; the first `count` settle now.

    t: int64 [frames]. t_base, t_before: the stamp before t[0] and the one before that. begin: int32 [E], bit k set
    where frame k (0 or 1) begins an episode. episodes: int32 [2, E], of frame 0 and of the later ones.
    """

    images: wp.array
    slopes: wp.array
    t: wp.array
    frames: int
    count: int
    t_base: int
    t_before: int
    begin: wp.array
    episodes: wp.array


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


class Plain:
    """Linear or frame stamps, no fault."""

    def __init__(self, size: Size, frame: bool, device: Any) -> None:
        total = size.envs * size.pixels
        self._kernel = plain_kernels(frame)[device.is_cuda]
        self._size, self._device = size, device
        self._before: wp.array = wp.zeros(total, dtype=kernels.Pixel, device=device)
        self._after: wp.array = wp.zeros(total, dtype=kernels.Pixel, device=device)
        self._base: wp.array = wp.zeros(total, dtype=wp.float64, device=device)

    def arrays(self) -> tuple[wp.array, ...]:
        """Everything that is kept per pixel."""
        return self._before, self._after, self._base

    def launch(self, sensor: kernels.Sensor, batch: Batch, keys: wp.array, counters: wp.array) -> None:
        """Events of a batch to `keys`, as many as fit; all are counted."""
        wp.launch(
            self._kernel,
            self._size.threads(self._device.is_cuda),
            [sensor, batch.images, batch.t, batch.t_base, batch.begin, self._before],
            [self._after, self._base, keys, counters],
            device=self._device,
        )

    def swap(self) -> None:
        self._before, self._after = self._after, self._before


class Pattern:
    """Fixed pattern of a sensor on its device; arrays of nothing where the sensor has none."""

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        envs, pixels = size.envs, size.pixels
        none = np.zeros(0, np.float32)
        on = off = leaks = hots = none
        if p["threshold_mismatch"] > 0:
            mean = (p["threshold_on"], p["threshold_off"])
            on, off = noise.thresholds(seed, envs, pixels, mean, p["threshold_mismatch"], p["threshold_floor"])
        if p["leak_rate"] > 0:
            leaks = noise.leak_rates(seed, envs, pixels, p["leak_rate"], p["leak_jitter"])
        if p["shot_rate"] > 0 or (p["hot_pixel_rate"] > 0 and p["hot_pixel_fraction"] > 0):
            hots = noise.hot_rates(seed, envs, pixels, p["hot_pixel_fraction"], p["hot_pixel_rate"])
        self.arrays: tuple[wp.array, ...] = tuple(
            wp.array(a, dtype=wp.float32, device=device) for a in (on, off, leaks, hots)
        )


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


class Full:
    """Curves and faults."""

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        total = size.envs * size.pixels
        self._kernel = full_kernels(features_of(p))[device.is_cuda]
        self._size, self._device = size, device
        self._pattern = Pattern(size, seed, p, device).arrays
        self._before: wp.array = wp.zeros(total, dtype=kernels_full.Hot, device=device)
        self._after: wp.array = wp.zeros(total, dtype=kernels_full.Hot, device=device)
        self._colds: wp.array = wp.zeros((2, total), dtype=kernels_full.Cold, device=device)

    def arrays(self) -> tuple[wp.array, ...]:
        """Everything that is kept per pixel."""
        return self._before, self._after, self._colds, *self._pattern

    def launch(self, sensor: kernels.Sensor, batch: Batch, keys: wp.array, counters: wp.array) -> None:
        """Events of a batch to `keys`, as many as fit; all are counted."""
        b = batch
        frames = [b.images, b.slopes, b.frames, b.count, b.t, b.t_base, b.t_before]
        wp.launch(
            self._kernel,
            self._size.threads(self._device.is_cuda),
            [sensor, b.begin, b.episodes, *frames, *self._pattern, self._before],
            [self._after, self._colds, keys, counters],
            device=self._device,
        )

    def swap(self) -> None:
        self._before, self._after = self._after, self._before


class Paper:
    """The paper's equations."""

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        total = size.envs * size.pixels
        self._kernel = (kernels_paper.paper_rows, kernels_paper.paper_pixels)[device.is_cuda]
        self._size, self._device = size, device
        self._pattern = Pattern(size, seed, p, device).arrays
        self._before: wp.array = wp.zeros(total, dtype=kernels_paper.PaperPixel, device=device)
        self._after: wp.array = wp.zeros(total, dtype=kernels_paper.PaperPixel, device=device)

    def arrays(self) -> tuple[wp.array, ...]:
        """Everything that is kept per pixel."""
        return self._before, self._after, *self._pattern

    def launch(self, sensor: kernels.Sensor, batch: Batch, keys: wp.array, counters: wp.array) -> None:
        """Events of a batch to `keys`, as many as fit; all are counted."""
        b = batch
        wp.launch(
            self._kernel,
            self._size.threads(self._device.is_cuda),
            [sensor, b.begin, b.episodes, b.images, b.t, b.t_base, *self._pattern, self._before],
            [self._after, keys, counters],
            device=self._device,
        )

    def swap(self) -> None:
        self._before, self._after = self._after, self._before


def make_engine(size: Size, seed: int, p: Mapping[str, Any], device: Any) -> Plain | Full | Paper:
    """The engine for resolved parameters: the plain one unless a curve or a fault is asked for."""
    if p["model"] == "evis-paper":
        return Paper(size, seed, p, device)
    if features_of(p) in (Features("linear"), Features("frame")):
        return Plain(size, p["crossing"] == "frame", device)
    return Full(size, seed, p, device)
