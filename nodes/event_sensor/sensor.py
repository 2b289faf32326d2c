"""Computes events from linear luminance: thresholds on log-intensity, several events per step, crossing times inside
the step.

Equations (3) and (4) of the method: L = ln(I + I_dark), and a pixel fires whenever L has moved from its reference by a
contrast threshold, the residual being kept. Each crossing has its own time, on the curve that `crossing` draws through
the frames.

The laws of noise, leak and refractory period stand in `model/faults/`, those of lens and photoreceptor in `optics/`,
that of the readout in `readout/`.

Marks. A sensor that is `marked` says of each event whether light or noise made it. Noise: what shot noise, a hot pixel
or a leak's coin fires, and a crossing to which the drift of a leak has gone further, in the sensor's step, than the
light (an ON event in constant light is always of that kind). Signal: every other crossing; mismatched thresholds, dead
time, photoreceptor and readout move its events and make none. Marks change no event and nothing of the pixels' state.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.devices import device_named
from evis.gpu.saved_arrays import joined, part_of, saved, write_back
from nodes.event_sensor.batches import BatchMaker
from nodes.event_sensor.cpu.event_list import HostEventList
from nodes.event_sensor.engines.engine import make_engine, sensor_struct
from nodes.event_sensor.input.batch import Batch, Size
from nodes.event_sensor.input.further import Further as Further
from nodes.event_sensor.input.further import problem
from nodes.event_sensor.model.features import marks
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import COUNTERS
from nodes.event_sensor.parameters import FLOOR as FLOOR
from nodes.event_sensor.parameters import LARGEST_SIDE, frames_only, is_own_model, resolve_sensor, thresholds_of
from nodes.event_sensor.readout.device_events import DeviceEvents, Pending, Ready
from nodes.event_sensor.readout.last_events import LastEvents
from nodes.event_sensor.readout.packet import Events as Events

wp.config.log_level = wp.LOG_WARNING

Frames = np.ndarray | wp.array | Any
"""Images in memory: numpy, Warp, or anything with __cuda_array_interface__."""


def _resolved(preset: str, given: dict[str, Any]) -> dict[str, Any]:
    """Gives every parameter of a sensor. Raises ValueError for values that do not go together."""
    p = resolve_sensor("event sensor", preset, given)
    p["threshold_on"], p["threshold_off"] = thresholds_of(p)
    if not is_own_model(p["model"]):
        raise ValueError(f"event model {p['model']} is made by nodes.event_sensor.peers.make_model")
    if p["model"] == "evis-paper" and p["crossing"] not in ("linear", "frame"):
        raise ValueError("event model evis-paper has no crossing: its events carry the stamps of frames")
    if p["crossing"] == "hermite" and p["bandwidth_hz"] > 0:
        raise ValueError("crossing=hermite needs the slope of what the pixel sees, which bandwidth_hz changes")
    return p


class EventSensor:
    """Simulates E event cameras of the same size.

    parameters: those of nodes.event_sensor.parameters.SENSOR, over those of `preset`. channels: 1 for luminance, 3 for
    colour, each channel an independent sensor. seed: environment e has the random numbers of a single sensor with seed
    + e. marked: events have a column `signal` too, see above. State per pixel and channel on a CPU (on a GPU): 28 (36)
    bytes for the ideal sensor, 76 (160) with a fault, 8 (16) more with a curve, 8 (16) more where something can happen
    without light, 4 more for a frame of look-ahead; 64 for evis-paper.

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
        marked: bool = False,
        **parameters: Any,
    ) -> None:
        """Raises ValueError for a size or a parameter out of range."""
        if not (1 <= height <= LARGEST_SIDE and 1 <= width <= LARGEST_SIDE and envs >= 1 and channels in (1, 3)):
            raise ValueError(f"event sensor cannot have {envs} x {height} x {width} pixels in {channels} channels")
        p = self.parameters = _resolved(preset, parameters)
        self.marked = marked
        noisy = p["photoreceptor_noise"] > 0
        if marked and noisy:
            raise ValueError("with photoreceptor_noise light and noise make each crossing together; do not mark events")
        p = {**p, "marked": marked}
        self.height, self.width, self.envs, self.channels = height, width, envs, channels
        self._device = device_named(device)
        self._layout = KeyLayout.of(height, width, envs, marks(p))
        seed = (seed + (1 << 63)) % (1 << 64) - (1 << 63)
        size = self._size = Size(height, width, channels, envs)
        self._noise = self._make_noise(size, seed) if noisy else None
        # With the noise comes exp(L) itself, for in the dark it goes below the dark current.
        of_light = {**p, "dark_level": 0.0} if noisy else p
        self._sensor = sensor_struct(of_light, (height, width, channels), self._layout, seed)
        self._engine: Any = make_engine(size, seed, of_light, self._device, self._layout)
        self._batches = BatchMaker(size, p, self._layout, self._device)
        self._readout = self._make_readout(seed)
        self._counters = np.zeros(len(COUNTERS), np.int64)
        """Of all calls so far."""
        self._event_list: Any = self._make_event_list(size)
        self._pipelined = (
            self._device.is_cuda and self._event_list.pipelined and self._batches.clear and not self._readout
        )
        all_signal = marked and not self._layout.marked
        self._last = LastEvents(self._event_list, self._readout, self.columns(), envs, all_signal)

    def _make_noise(self, size: Size, seed: int) -> Any:
        """Makes what adds the photoreceptor's noise to what it gives."""
        from nodes.event_sensor.optics.photoreceptor_noise import PhotoreceptorNoise

        return PhotoreceptorNoise(size, seed, self.parameters, self._device)

    def _make_readout(self, seed: int) -> Any:
        """Makes what delays events on their way out of the sensor; None where nothing does."""
        p = self.parameters
        if not (p["readout_rate"] > 0 or p["timestamp_jitter_us"] > 0):
            return None
        from nodes.event_sensor.readout.readout import Readout

        return Readout(self.width, self.height, self.envs, p["readout_rate"], p["timestamp_jitter_us"], seed=seed)

    def _make_event_list(self, size: Size) -> Any:
        """Makes what lists and sorts the events: on the host or on a GPU."""
        total = size.envs * size.pixels
        if not self._device.is_cuda:
            ordered = self._readout is None or self._readout.queues
            return HostEventList(self._engine, self._sensor, self._layout, size.envs, total, self._count, ordered)
        from nodes.event_sensor.cuda.event_list import DeviceEventList

        stamped = self.parameters["model"] == "evis-paper" or self.parameters["crossing"] == "frame"
        shape = (size.envs, total, size.channels == 3)
        return DeviceEventList(self._engine, self._sensor, self._layout, shape, stamped, self._device, self._count)

    def _count(self, found: np.ndarray) -> None:
        self._counters += found

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that take long to compile, as `build_together` takes them."""
        return [*self._engine.kernels(), *self._event_list.kernels()]

    @property
    def device(self) -> str:
        """Names the device that its pixels are on."""
        return str(self._device)

    @property
    def state_bytes(self) -> int:
        """Returns the bytes kept per pixel and channel, those of photoreceptor and readout apart."""
        kept = sum(a.capacity for a in self._engine.arrays())
        return round(kept / (self.envs * self._size.pixels)) + (4 if self._batches.looks_ahead else 0)

    def state(self) -> dict[str, Any]:
        """Gives what the next events depend on, as plain arrays and numbers; the fixed pattern and the parameters are
        those of a sensor that is made alike. No call may be in flight."""
        parts: dict[str, dict[str, Any]] = {"pixels": saved(self._engine.present())}
        beside = {"readout": self._readout, "noise": self._noise}
        parts |= {name: made.state() for name, made in beside.items() if made is not None}
        return {**joined(parts), **self._batches.state(), "counters": np.array(self._counters)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores what `state` gave for a sensor of the same size, parameters, seed and kind of device.

        Raises ValueError for a state whose arrays are others.
        """
        write_back(self._engine.present(), part_of(state, "pixels"))
        self._batches.restore(state)
        for name, made in {"readout": self._readout, "noise": self._noise}.items():
            if made is not None:
                made.restore(part_of(state, name))
        self._counters = np.array(state["counters"], np.int64)

    begins_again = True
    """Another episode at the same times has other random numbers."""

    @property
    def takes_further(self) -> bool:
        """Tells whether it takes further samples of single pixels between the frames."""
        return not frames_only(self.parameters)

    def takes_at_once(self, t: np.ndarray, further: bool = False) -> bool:
        """Tells whether the next frames, at times int64 [K] ns of the episode, may come in one call although they are
        of several messages: the events of each are then those of (stamp before, stamp]. further: with samples between
        them."""
        if self._batches.looks_ahead or self._readout is not None or self.envs > 1:
            return False
        return not (self.marked and self._device.is_cuda) and self._batches.fits_one_call(t, further)

    @property
    def stamp(self) -> int:
        """Returns the stamp [ns] up to which events have been given: that of the last frame, with look-ahead of the one
        before."""
        return self._batches.settled

    @property
    def t_base(self) -> int:
        """Returns the stamp [ns] after which the events of the last call lie."""
        return self._batches.t_base

    def process(
        self,
        luminance: Frames,
        t: np.ndarray,
        episodes: np.ndarray,
        dlog_dt: Frames | None = None,
        further: Further | None = None,
    ) -> Events:
        """Returns the events of K frames: `advance`, then `read` into new arrays."""
        return self._events(self.advance(luminance, t, episodes, dlog_dt, further))

    def process_async(
        self,
        luminance: Frames,
        t: np.ndarray,
        episodes: np.ndarray,
        dlog_dt: Frames | None = None,
        further: Further | None = None,
        defer: bool = True,
    ) -> Pending | Ready:
        """Computes events of K frames, which stay on the sensor's device; `result()` of what this returns gives them.

        On a CUDA device the ideal sensor has up to CALLS calls in flight: this launches the work and returns, and
        result() waits for it. The frames must stay unchanged until then. A call for which there is no room any more,
        because the results of earlier ones were not taken, raises ValueError. Other sensors are done at once. Where
        further samples are wrong, its result() raises ValueError. defer: its events are put in order beside the next
        call's work, for who takes its result after that.
        """
        batch, begins = self._batches.take(luminance, t, episodes, dlog_dt, further, waits=not self._pipelined)
        if self._pipelined:
            pending = self._last.submit(batch, self.stamp, defer)
            if batch.further is not None:
                pending.problem = partial(problem, batch.further, self._size)
            return pending
        n = self._settle(batch, begins)
        if self.on_gpu is not None:
            return Ready(self._event_list.events)
        span = (batch.t_base, self.stamp)
        return Ready(DeviceEvents.of(self._events(n), self._device, span))

    def flush(self) -> Events:
        """Gives the events still held back at the end of a stream: `finish`, then `read` into new arrays."""
        return self._events(self.finish())

    def _events(self, n: int) -> Events:
        out: dict[str, np.ndarray] = {name: np.empty(n, dtype) for name, dtype in self.columns().items()}
        self.read(out)
        events = Events(out["t"], out["x"], out["y"], out["p"], out.get("c"), self.env_offsets())
        events.signal = out.get("signal")
        return events

    def columns(self) -> dict[str, type]:
        """Gives the columns of an event and their dtypes."""
        columns: dict[str, type] = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8}
        if self.channels == 3:
            columns["c"] = np.uint8
        if self.marked:
            columns["signal"] = np.uint8
        return columns

    def advance(
        self,
        luminance: Frames,
        t: np.ndarray,
        episodes: np.ndarray,
        dlog_dt: Frames | None = None,
        further: Further | None = None,
    ) -> int:
        """Takes K frames and returns how many events they make; `read` gives them.

        luminance: float32 [E, K, H, W] or, with three channels, [E, K, H, W, 3], linear: numpy, Warp (colour as vec3f
        [E, K, H, W]) or whatever has __cuda_array_interface__, such as PyTorch. It is not copied where it is on the
        sensor's device, and must have been written there on Warp's stream, the default stream, or one that is
        synchronised. t: int64 [K] ns, ascending, after the stamps seen before. episodes: int [E]; where it differs from
        the last call's, the first frame sets the reference and fires nothing. dlog_dt: float32, of luminance's shape,
        d ln I/dt [1/s], for crossing=hermite, NaN where it is not known. further: samples of single pixels between the
        frames, for crossing=linear; such a pixel has the events that frames at its samples would give. Events lie in
        (t_base, stamp], which is (previous stamp, t[-1]] without look-ahead; with it, each bound is the frame before.
        Raises ValueError.
        """
        return self._settle(*self._batches.take(luminance, t, episodes, dlog_dt, further))

    def finish(self) -> int:
        """Takes no more frames; returns how many events were held back. `advance` may go on afterwards."""
        made = self._batches.finish()
        if made is None:
            self._last.clear()
        else:
            self._settle(*made)
        self._last.add_late()
        return len(self._last)

    def _settle(self, batch: Batch, begins: np.ndarray) -> int:
        """Lists the events of a batch, sorted; gives their number. begins: bool [E], who begins an episode with it."""
        parts: Iterable[tuple[Batch, int]] = [(batch, self.stamp)]
        if self._noise is not None:
            parts = ((part, int(part.t[-1])) for part in self._noise.parts(batch))
        self._last.fill(parts, begins)
        return len(self._last)

    def counts(self) -> dict[str, int]:
        """Counts what was set aside so far.

        nonfinite: samples that were NaN, infinite, negative, or 0 without dark current (the last good one is held).
        clipped: samples below FLOOR that were a reference or left the pixel's inactive range. dropped: events beyond
        event_cap. unknown_slopes: samples of dlog_dt that were not finite (the chord is taken). readout_*: those of
        Readout.
        """
        counts = {name: int(n) for name, n in zip(COUNTERS[1:], self._counters[1:])}
        if not self._batches.hermite:
            del counts["unknown_slopes"]
        if self._readout is not None:
            counts |= {f"readout_{name}": n for name, n in self._readout.counts().items()}
        return counts

    @property
    def longest_delay_ns(self) -> int:
        """Returns the longest time that an event has waited for the readout so far [ns]; 0 without one."""
        return 0 if self._readout is None else int(self._readout.longest_ns)

    @property
    def on_gpu(self) -> Any:
        """Returns the GPU that the events of the last `advance` or `finish` are on; None where they are on the host."""
        return self._device if self._device.is_cuda and not self._last.on_host else None

    def read(self, out: Any) -> None:
        """Writes the events of the last `advance` or `finish` to arrays of `columns()`, name -> array.

        Of numpy or, where they are `on_gpu`, Warp's there.
        """
        self._last.read(out)

    def read_call(self, events: Any, out: Any) -> None:
        """Writes the events of a call, which `process_async` has begun, to arrays of `columns()`, as `read` does; where
        nothing but light makes any, all of them are signal."""
        self._last.read_call(events, out)

    def env_offsets(self) -> np.ndarray:
        """Returns int64 [E + 1] of the last `advance` or `finish`."""
        return self._last.env_offsets()
