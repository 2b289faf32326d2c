"""Events from linear luminance: thresholds on log-intensity, several events per step, crossing times inside the step.

Equations (3) and (4) of the method: L = ln(I + I_dark), and a pixel fires whenever L has moved from its reference by a
contrast threshold, the residual being kept. Each crossing has its own time, linear in L inside the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from nodes.event_sensor import kernels
from nodes.event_sensor.defocus import Defocus
from nodes.event_sensor.packet import KeyLayout, env_offsets, sort_keys, unpack
from nodes.interpolator.keyframe import device_named

wp.config.log_level = wp.LOG_WARNING

FLOOR = 2.0**-24
"""Least I + I_dark [radiance]: the smallest positive half-precision radiance. An ideal sensor without dark current
would otherwise answer a black pixel with infinitely many events."""


@dataclass
class Events:
    """Events sorted by environment, t, y, x. t int64 [n] ns; x, y uint16 [n]; p uint8 [n], 1 = ON; c uint8 [n] or None.

    env_offsets int64 [E + 1]: events of environment e are [offsets[e], offsets[e + 1]).
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    c: np.ndarray | None
    env_offsets: np.ndarray


class EventSensor:
    """E event cameras of the same size.

    threshold_on, threshold_off: contrast thresholds in ln I. dark_level: I_dark, in the unit of the luminance. defocus:
    standard deviation of the blur [px], 0 = none. channels: 1 for luminance, 3 for colour, each channel an independent
    sensor. `nonfinite` counts samples that were NaN, infinite or negative (they fire nothing and leave the pixel as it
    was), `clipped` samples below FLOOR that were a reference or left the pixel's quiet band.
    """

    def __init__(
        self,
        height: int,
        width: int,
        envs: int = 1,
        *,
        threshold_on: float = 0.2,
        threshold_off: float = 0.2,
        dark_level: float = 0.0,
        defocus: float = 0.0,
        channels: int = 1,
        device: str = "cpu",
    ) -> None:
        """Raises ValueError for a size or a parameter out of range."""
        if not (1 <= height <= 65536 and 1 <= width <= 65536 and envs >= 1 and channels in (1, 3)):
            raise ValueError(f"event sensor cannot have {envs} x {height} x {width} pixels in {channels} channels")
        if not (0.001 <= threshold_on <= 10 and 0.001 <= threshold_off <= 10):
            raise ValueError(f"contrast thresholds {threshold_on:g}, {threshold_off:g} must lie in 0.001 to 10")
        if not (math.isfinite(dark_level) and dark_level >= 0 and math.isfinite(defocus) and defocus >= 0):
            raise ValueError(f"dark_level {dark_level:g} and defocus {defocus:g} must be finite and not negative")
        self.height, self.width, self.envs, self.channels = height, width, envs, channels
        self.nonfinite = 0
        self.clipped = 0
        self.t_base = 0
        self._device = device_named(device)
        self._layout = KeyLayout.of(height, width, envs)
        self._sensor = self._parameters(threshold_on, threshold_off, dark_level)
        self._defocus = Defocus(defocus, str(self._device)) if defocus > 0 else None
        size = envs * height * width * channels
        device = self._device
        self._before = wp.zeros(size, dtype=kernels.Pixel, device=device)
        self._after = wp.zeros(size, dtype=kernels.Pixel, device=device)
        self._base = wp.zeros(size, dtype=wp.float64, device=device)
        self._counters = wp.zeros(3, dtype=wp.int64, device=device)
        self._keys = self._spare = wp.empty(0, dtype=wp.int64, device=device)
        self._grow(max(2 * size, 4096))
        self._episodes: np.ndarray | None = None
        self._last_stamp = 0
        self._sorted = np.zeros(0, np.int64)

    def _parameters(self, threshold_on: float, threshold_off: float, dark_level: float) -> kernels.Sensor:
        values = {
            "threshold_on": threshold_on,
            "threshold_off": threshold_off,
            "gain_on": math.exp(threshold_on),
            "gain_off": math.exp(-threshold_off),
            "dark": dark_level,
            "floor": FLOOR,
            "height": self.height,
            "width": self.width,
            "channels": self.channels,
            "shift_x": self._layout.x,
            "shift_y": self._layout.y,
            "shift_t": self._layout.t,
            "shift_env": self._layout.env,
        }
        sensor = kernels.Sensor()
        for name, value in values.items():
            setattr(sensor, name, value)
        return sensor

    def _grow(self, capacity: int) -> None:
        """Room for `capacity` events; a GPU's radix sort needs the array to be twice as long."""
        length = 2 * capacity if self._device.is_cuda else capacity
        self._keys = wp.empty(length, dtype=wp.int64, device=self._device)
        self._spare = wp.empty(capacity, dtype=wp.int64, device=self._device) if length == capacity else self._keys
        self._capacity = capacity
        self._sensor.capacity = wp.int64(capacity)

    def process(self, luminance: np.ndarray | wp.array, t: np.ndarray, episodes: np.ndarray) -> Events:
        """Events of K frames: `advance`, then `read` into new arrays."""
        n = self.advance(luminance, t, episodes)
        out: dict[str, np.ndarray] = {name: np.empty(n, dtype) for name, dtype in self.columns().items()}
        self.read(out)
        return Events(out["t"], out["x"], out["y"], out["p"], out.get("c"), self.env_offsets())

    def columns(self) -> dict[str, type]:
        """Columns of an event and their dtypes."""
        columns: dict[str, type] = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8}
        if self.channels == 3:
            columns["c"] = np.uint8
        return columns

    def advance(self, luminance: np.ndarray | wp.array, t: np.ndarray, episodes: np.ndarray) -> int:
        """Take K frames and return how many events they make; `read` gives them.

        luminance: float32 [E, K, H, W] or, with three channels, [E, K, H, W, 3], linear; numpy, or Warp on the sensor's
        device. t: int64 [K] ns, ascending, after the stamps seen before. episodes: int [E]; where it differs from the
        last call's, the first frame sets the reference and fires nothing. Events lie in (previous stamp, t[-1]].
        Raises ValueError.
        """
        t = np.ascontiguousarray(t, dtype=np.int64)
        fresh = self._fresh(luminance.shape, t, np.asarray(episodes))
        self.t_base = int(t[0]) if fresh.all() else self._last_stamp
        span = int(t[-1]) - self.t_base
        self._layout.check_span(span)
        if isinstance(luminance, wp.array):
            images = luminance.flatten()
        else:
            images = wp.array(np.reshape(luminance, -1), dtype=wp.float32, device=self._device, copy=False)
        if self._defocus is not None:
            images = self._defocus(images.reshape((-1, self.height, self.width, self.channels))).flatten()
        count, nonfinite, clipped = self._launch(images, t, fresh)
        self._before, self._after = self._after, self._before
        self._episodes = np.array(episodes)
        self._last_stamp = int(t[-1])
        self.nonfinite += nonfinite
        self.clipped += clipped
        self._sorted = sort_keys(self._keys, self._spare, count, self._layout, span)
        return count

    def _fresh(self, shape: tuple[int, ...], t: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        expected = (self.envs, len(t), self.height, self.width) + ((3,) if self.channels == 3 else ())
        if tuple(shape) != expected or len(t) == 0:
            raise ValueError(f"event sensor got luminance {tuple(shape)} with {len(t)} stamps, expected {expected}")
        if np.prod(shape) >= 1 << 31:
            raise ValueError(f"event sensor got {tuple(shape)} samples in one message, 2^31 are too many")
        if episodes.shape != (self.envs,):
            raise ValueError(f"event sensor got episodes of shape {episodes.shape}, expected ({self.envs},)")
        if np.any(np.diff(t) <= 0):
            raise ValueError("event sensor got stamps that do not ascend")
        fresh = np.ones(self.envs, bool) if self._episodes is None else episodes != self._episodes
        if not fresh.all() and t[0] <= self._last_stamp:
            raise ValueError(f"event sensor got a frame at {t[0]} ns after one at {self._last_stamp} ns of the episode")
        return fresh

    def _launch(self, images: wp.array, t: np.ndarray, fresh: np.ndarray) -> tuple[int, int, int]:
        """Run the kernel; again with a longer buffer when the events did not fit (its input state is untouched)."""
        device = self._device
        kernel = kernels.sense_pixels if device.is_cuda else kernels.sense_rows
        dim: tuple[int, ...] = (self.envs, self.height)
        if device.is_cuda:
            dim = (*dim, self.width * self.channels)
        stamps: wp.array = wp.array(t, device=device)
        starts: wp.array = wp.array(fresh.astype(np.int32), device=device)
        while True:
            self._counters.zero_()
            wp.launch(
                kernel,
                dim,
                [self._sensor, images, stamps, self.t_base, starts, self._before],
                [self._after, self._base, self._keys, self._counters],
                device=device,
            )
            count, nonfinite, clipped = (int(v) for v in self._counters.numpy())
            if count <= self._capacity:
                return count, nonfinite, clipped
            if count >= 1 << 31:
                raise ValueError(f"{count} events in one message; raise the contrast threshold or keyframe_rate")
            self._grow(count + count // 4)

    def counts(self) -> tuple[int, int]:
        """Samples so far that were not finite or negative, and samples below FLOOR."""
        return self.nonfinite, self.clipped

    def read(self, out: dict[str, np.ndarray]) -> None:
        """Write the events of the last `advance` to arrays of `columns()`."""
        unpack(self._sorted, self._sensor, self.t_base, out)

    def env_offsets(self) -> np.ndarray:
        """int64 [E + 1] of the last `advance`."""
        return env_offsets(self._sorted, self._layout, self.envs)
