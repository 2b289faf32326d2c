"""Events from linear luminance: thresholds on log-intensity, several events per step, crossing times inside the step.

Equations (3) and (4) of the method: L = ln(I + I_dark), and a pixel fires whenever L has moved from its reference by a
contrast threshold, the residual being kept. Each crossing has its own time, on the curve that `crossing` draws through
the frames.

Noise. Every event resets the pixel, as in silicon: after a shot, hot-pixel or coin event the reference is L at its
time, so that no later crossing is lost and no pixel goes deaf, and noise shifts the signal's events as it does in a
real pixel. After a refractory period, in which the pixel is held in reset, the reference is L at the period's end. A
leak lets the reference fall at leak_rate x threshold_on; it and the signal share one crossing. Shot noise and hot
pixels are one Poisson process per pixel in continuous time, thinned with the light at each candidate's time (linear
between frames); their polarity is drawn evenly. Nothing of this knows the frame rate. All pixels of an episode begin
with their reference at its first frame, so that a leak without jitter or mismatch fires in step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor import kernels
from nodes.event_sensor.defocus import Defocus
from nodes.event_sensor.engines import FLOOR as FLOOR
from nodes.event_sensor.engines import Batch, Size, make_engine, sensor_struct
from nodes.event_sensor.packet import Events as Events
from nodes.event_sensor.packet import KeyLayout, env_offsets, merged, sort_keys, unpack
from nodes.event_sensor.parameters import resolve_sensor
from nodes.interpolator.keyframe import device_named

wp.config.log_level = wp.LOG_WARNING

LOOK_AHEAD = ("monotone", "cubic")
"""Crossing methods whose curve needs the frame after the step."""


@dataclass
class Held:
    """The frame whose step waits for the next one. begins: bool [E], environments whose episode it begins."""

    images: wp.array
    stamp: int
    begins: np.ndarray
    episodes: np.ndarray


class EventSensor:
    """E event cameras of the same size.

    parameters: those of nodes.event_sensor.parameters.SENSOR, over those of `preset`. channels: 1 for luminance, 3 for
    colour, each channel an independent sensor. seed: environment e has the random numbers of a single sensor with seed
    + e. State per pixel and channel on a CPU (on a GPU): 28 (48) bytes for the ideal sensor, 88 (176) with a curve or a
    fault, 8 (16) more where something can happen without light, 4 more for a frame of look-ahead; 48 for evis-paper.

    With look-ahead (crossing monotone or cubic) a step's events come one frame later, at the end of it by `flush`.
    """

    def __init__(
        self,
        height: int,
        width: int,
        envs: int = 1,
        *,
        channels: int = 1,
        device: str = "cpu",
        seed: int = 0,
        preset: str = "ideal",
        **parameters: Any,
    ) -> None:
        """Raises ValueError for a size or a parameter out of range."""
        if not (1 <= height <= 65536 and 1 <= width <= 65536 and envs >= 1 and channels in (1, 3)):
            raise ValueError(f"event sensor cannot have {envs} x {height} x {width} pixels in {channels} channels")
        p = resolve_sensor("event sensor", preset, parameters)
        for side in ("threshold_on", "threshold_off"):
            p[side] = p["threshold"] if p[side] is None else p[side]
        if not p["model"].startswith("evis"):
            raise ValueError(f"event model {p['model']} is made by nodes.event_sensor.models.make_model")
        if p["crossing"] == "hermite" and p["bandwidth_hz"] > 0:
            raise ValueError("crossing=hermite needs the slope of what the pixel sees, which bandwidth_hz changes")
        self.parameters = p
        self.height, self.width, self.envs, self.channels = height, width, envs, channels
        self.t_base = 0
        self._device = device_named(device)
        self._layout = KeyLayout.of(height, width, envs)
        seed = (seed + (1 << 63)) % (1 << 64) - (1 << 63)
        self._sensor = sensor_struct(p, (height, width, channels), self._layout, seed)
        size = Size(height, width, channels, envs)
        self._engine = make_engine(size, seed, p, self._device)
        self._size = size.pixels
        self._ahead = p["model"] == "evis" and p["crossing"] in LOOK_AHEAD
        self._hermite = p["model"] == "evis" and p["crossing"] == "hermite"
        self._optics(seed)
        device = self._device
        self._nothing: wp.array = wp.zeros(0, dtype=wp.float32, device=device)
        self._counters: wp.array = wp.zeros(len(kernels.COUNTERS) + 1, dtype=wp.int64, device=device)
        self._keys: wp.array = wp.empty(0, dtype=wp.int64, device=device)
        self._spare = self._keys
        self._grow(max(2 * envs * size.pixels, 4096))
        self._total = np.zeros(len(kernels.COUNTERS), np.int64)
        self._episodes: np.ndarray | None = None
        self._last_stamp = self._settled = self._settled_before = 0
        self._held: Held | None = None
        self._sorted = np.zeros(0, np.int64)
        self._left: tuple[dict[str, np.ndarray], np.ndarray] | None = None

    def _optics(self, seed: int) -> None:
        """What comes before and after the kernel; not constructed where it does nothing."""
        p = self.parameters
        self._defocus = self._defocus_slopes = self._photoreceptor = self._readout = None
        if p["defocus_px"] > 0:
            self._defocus = Defocus(p["defocus_px"], str(self._device))
            if self._hermite:
                self._defocus_slopes = Defocus(p["defocus_px"], str(self._device))
        if p["bandwidth_hz"] > 0:
            from nodes.event_sensor.photoreceptor import Photoreceptor

            self._photoreceptor = Photoreceptor(
                self.height,
                self.width,
                self.envs,
                self.channels,
                bandwidth_hz=p["bandwidth_hz"],
                bandwidth_level=p["bandwidth_level"],
                poles=p["bandwidth_poles"],
                dark_level=p["dark_level"],
                device=str(self._device),
            )
        if p["readout_rate"] > 0 or p["timestamp_jitter_us"] > 0:
            from nodes.event_sensor.readout import Readout

            self._readout = Readout(
                self.width, self.height, self.envs, p["readout_rate"], p["timestamp_jitter_us"], seed=seed
            )

    def _grow(self, capacity: int) -> None:
        """Room for `capacity` events; a GPU's radix sort needs the array to be twice as long."""
        length = 2 * capacity if self._device.is_cuda else capacity
        self._keys = wp.empty(length, dtype=wp.int64, device=self._device)
        self._spare = wp.empty(capacity, dtype=wp.int64, device=self._device) if length == capacity else self._keys
        self._capacity = capacity
        self._sensor.capacity = wp.int64(capacity)

    @property
    def state_bytes(self) -> int:
        """Bytes kept per pixel and channel, those of photoreceptor and readout apart."""
        kept = sum(a.capacity for a in self._engine.arrays())
        return round(kept / (self.envs * self._size)) + (4 if self._ahead else 0)

    @property
    def stamp(self) -> int:
        """Events up to this stamp [ns] have been given: that of the last frame, with look-ahead of the one before."""
        return self._settled

    def process(
        self,
        luminance: np.ndarray | wp.array,
        t: np.ndarray,
        episodes: np.ndarray,
        dlog_dt: np.ndarray | wp.array | None = None,
    ) -> Events:
        """Events of K frames: `advance`, then `read` into new arrays."""
        return self._events(self.advance(luminance, t, episodes, dlog_dt))

    def flush(self) -> Events:
        """What is still held back, at the end of a stream: `finish`, then `read` into new arrays."""
        return self._events(self.finish())

    def _events(self, n: int) -> Events:
        out: dict[str, np.ndarray] = {name: np.empty(n, dtype) for name, dtype in self.columns().items()}
        self.read(out)
        return Events(out["t"], out["x"], out["y"], out["p"], out.get("c"), self.env_offsets())

    def columns(self) -> dict[str, type]:
        """Columns of an event and their dtypes."""
        columns: dict[str, type] = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8}
        if self.channels == 3:
            columns["c"] = np.uint8
        return columns

    def advance(
        self,
        luminance: np.ndarray | wp.array,
        t: np.ndarray,
        episodes: np.ndarray,
        dlog_dt: np.ndarray | wp.array | None = None,
    ) -> int:
        """Take K frames and return how many events they make; `read` gives them.

        luminance: float32 [E, K, H, W] or, with three channels, [E, K, H, W, 3], linear; numpy, or Warp on the sensor's
        device. t: int64 [K] ns, ascending, after the stamps seen before. episodes: int [E]; where it differs from the
        last call's, the first frame sets the reference and fires nothing. dlog_dt: float32, of luminance's shape, d ln
        I/dt [1/s], for crossing=hermite, NaN where it is not known. Events lie in (t_base, stamp], which is (previous
        stamp, t[-1]] without look-ahead; with it, each bound is the frame before. Raises ValueError.
        """
        t = np.ascontiguousarray(t, dtype=np.int64)
        episodes = np.asarray(episodes)
        fresh = self._fresh(luminance.shape, t, episodes)
        if self._hermite and (dlog_dt is None or tuple(dlog_dt.shape) != tuple(luminance.shape)):
            raise ValueError("crossing=hermite needs dlog_dt of the luminance's shape; without it take crossing=cubic")
        if self._held is not None and fresh.all() and t[0] <= self._last_stamp:
            raise ValueError(f"time goes back to {t[0]} ns; flush() first gives the events that are held back")
        begun = self._held is not None or not fresh.all()
        t_base = self._settled if begun else int(t[0])
        self._layout.check_span(int(t[-1]) - t_base)
        images = self._seen(self._on_device(luminance), t, fresh, t_base)
        slopes = self._nothing
        if self._hermite and dlog_dt is not None:
            slopes = self._slopes(self._on_device(dlog_dt), self._on_device(luminance), images)
        if not begun:
            self._settled_before = t_base
        self._episodes, self._last_stamp = episodes.astype(np.int32), int(t[-1])
        if not self._ahead:
            return self._settle(images, slopes, t, len(t), t_base, [fresh], [self._episodes])
        begins, of, old = [fresh], [self._episodes], self._held
        if old is not None:
            begins, of = [old.begins, fresh], [old.episodes, self._episodes]
            t = np.concatenate(([old.stamp], t))
        new = images.reshape((self.envs, -1, self._size))
        rest = begins[len(t) - 1] if len(t) <= len(begins) else np.zeros(self.envs, bool)
        last: wp.array = wp.empty((self.envs, self._size), dtype=wp.float32, device=self._device)
        _copy(last, new[:, -1])
        self._held = Held(last, int(t[-1]), rest, of[-1])
        if old is not None:
            joined: wp.array = wp.empty((self.envs, len(t), self._size), dtype=wp.float32, device=self._device)
            _copy(joined[:, 0], old.images)
            _copy(joined[:, 1:], new)
            images = joined.flatten()
        return self._settle(images, slopes, t, len(t) - 1, t_base, begins, of)

    def finish(self) -> int:
        """Take no more frames; returns how many events were held back. `advance` may go on afterwards."""
        held, self._held = self._held, None
        if held is None:
            self.t_base = self._settled
            self._sorted = np.zeros(0, np.int64)
            self._left = ({n: np.zeros(0, d) for n, d in self.columns().items()}, np.zeros(self.envs + 1, np.int64))
        else:
            stamp = np.array([held.stamp], np.int64)
            self._settle(held.images.flatten(), self._nothing, stamp, 1, self._settled, [held.begins], [held.episodes])
        if self._readout is not None:
            assert self._left is not None
            rest = self._readout.flush()
            if rest is not None:
                self._left = merged(self._left, rest, self.envs)
        return len(self._sorted) if self._left is None else len(self._left[0]["t"])

    def _on_device(self, values: np.ndarray | wp.array) -> wp.array:
        if isinstance(values, wp.array):
            return values.flatten()
        flat = np.ascontiguousarray(np.reshape(values, -1), dtype=np.float32)
        return wp.array(flat, dtype=wp.float32, device=self._device, copy=False)

    def _seen(self, images: wp.array, t: np.ndarray, fresh: np.ndarray, t_base: int) -> wp.array:
        """Through lens and photoreceptor."""
        if self._defocus is not None:
            images = self._defocus(images.reshape((-1, self.height, self.width, self.channels))).flatten()
        if self._photoreceptor is not None:
            before = self._last_stamp if not fresh.all() else int(t[0])
            images = self._photoreceptor.advance(images, t, before, fresh).flatten()
        return images

    def _slopes(self, slopes: wp.array, sharp: wp.array, seen: wp.array) -> wp.array:
        """d ln I/dt of what is seen: the blur is linear in I, so it is (blur of I times slope) / (blur of I)."""
        if self._defocus_slopes is None:
            return slopes
        change: wp.array = wp.empty_like(slopes)
        wp.launch(kernels.product, len(slopes), [slopes, sharp], [change], device=self._device)
        blurred = self._defocus_slopes(change.reshape((-1, self.height, self.width, self.channels))).flatten()
        wp.launch(kernels.quotient, len(slopes), [blurred, seen], [change], device=self._device)
        return change

    def _fresh(self, shape: tuple[int, ...], t: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        expected = (self.envs, len(t), self.height, self.width) + ((3,) if self.channels == 3 else ())
        if tuple(shape) != expected or len(t) == 0:
            raise ValueError(f"event sensor got luminance {tuple(shape)} with {len(t)} stamps, expected {expected}")
        if math.prod(shape) >= 1 << 31:
            raise ValueError(f"event sensor got {tuple(shape)} samples in one message, 2^31 are too many")
        if episodes.shape != (self.envs,):
            raise ValueError(f"event sensor got episodes of shape {episodes.shape}, expected ({self.envs},)")
        if np.any(t[1:] <= t[:-1]):
            raise ValueError("event sensor got stamps that do not ascend")
        fresh = np.ones(self.envs, bool) if self._episodes is None else episodes != self._episodes
        if not fresh.all() and t[0] <= self._last_stamp:
            raise ValueError(f"event sensor got a frame at {t[0]} ns after one at {self._last_stamp} ns of the episode")
        return fresh

    def _settle(
        self,
        images: wp.array,
        slopes: wp.array,
        t: np.ndarray,
        count: int,
        t_base: int,
        begins: list[np.ndarray],
        episodes: list[np.ndarray],
    ) -> int:
        """Events of the first `count` frames, sorted; later frames are only looked at."""
        self.t_base = t_base
        flags = np.sum([np.asarray(b, np.int32) << k for k, b in enumerate(begins)], 0)
        device = self._device
        batch = Batch(
            images,
            slopes,
            wp.array(t, dtype=wp.int64, device=device, copy=False),
            len(t),
            count,
            t_base,
            self._settled_before,
            wp.array(flags, dtype=wp.int32, device=device, copy=False),
            wp.array(np.stack((episodes[0], episodes[-1])), dtype=wp.int32, device=device, copy=False),
        )
        found = self._launch(batch) if count else np.zeros(len(kernels.COUNTERS), np.int64)
        self._total += found
        stamp = int(t[count - 1]) if count else t_base
        if stamp != t_base or count:
            before = int(t[count - 2]) if count > 1 else t_base
            self._settled_before, self._settled = before, stamp
        else:
            self._settled = t_base
        self._sorted = sort_keys(self._keys, self._spare, int(found[0]), self._layout, stamp - t_base)
        self._left = None
        if self._readout is None:
            return len(self._sorted)
        out: dict[str, np.ndarray] = {n: np.empty(len(self._sorted), d) for n, d in self.columns().items()}
        unpack(self._sorted, self._sensor, t_base, out)
        offsets = env_offsets(self._sorted, self._layout, self.envs)
        self._left = self._readout.apply(out, offsets, t_base, stamp, begins[0])
        return len(self._left[0]["t"])

    def _launch(self, batch: Batch) -> np.ndarray:
        """Run the kernel; on, or again, with a longer buffer when the events did not fit. Returns the counters."""
        self._counters.zero_()
        resume = 0
        while True:
            self._engine.launch(self._sensor, batch, self._keys, self._counters, resume)
            found = np.array(self._counters.numpy())
            count, left = int(found[0]), int(found[-1])
            if not left and count <= self._capacity:
                self._engine.swap()
                return found[:-1]
            if max(count, left and 2 * self._capacity) >= 1 << 31:
                raise ValueError(f"{count} events in one message; raise the contrast threshold or keyframe_rate")
            keys = self._keys
            self._grow(2 * self._capacity if left else count + count // 4)
            if left:
                self._keys.numpy()[:count] = keys.numpy()[:count]
                self._counters.numpy()[-1] = 0
                resume = left - 1
            else:
                self._counters.zero_()

    def counts(self) -> dict[str, int]:
        """What was set aside so far.

        nonfinite: samples that were NaN, infinite or negative (the last good one is held). clipped: samples below FLOOR
        that were a reference or left the pixel's quiet band. dropped: events beyond event_cap. unknown_slopes: samples
        of dlog_dt that were not finite (the chord is taken). readout_*: those of Readout.
        """
        counts = {name: int(n) for name, n in zip(kernels.COUNTERS[1:], self._total[1:])}
        if not self._hermite:
            del counts["unknown_slopes"]
        if self._readout is not None:
            counts |= {f"readout_{name}": n for name, n in self._readout.counts().items()}
        return counts

    @property
    def nonfinite(self) -> int:
        """counts()["nonfinite"]."""
        return int(self._total[kernels.COUNTERS.index("nonfinite")])

    @property
    def clipped(self) -> int:
        """counts()["clipped"]."""
        return int(self._total[kernels.COUNTERS.index("clipped")])

    def read(self, out: dict[str, np.ndarray]) -> None:
        """Write the events of the last `advance` or `finish` to arrays of `columns()`."""
        if self._left is None:
            unpack(self._sorted, self._sensor, self.t_base, out)
        else:
            for name, column in self._left[0].items():
                out[name][:] = column

    def env_offsets(self) -> np.ndarray:
        """int64 [E + 1] of the last `advance` or `finish`."""
        return env_offsets(self._sorted, self._layout, self.envs) if self._left is None else self._left[1]


def _copy(to: wp.array, source: wp.array) -> None:
    """Copy between arrays of one device, which may be slices; numpy moves whole rows where it can."""
    if wp.get_device(to.device).is_cuda:
        wp.copy(to, source)
    else:
        to.numpy()[...] = source.numpy()
