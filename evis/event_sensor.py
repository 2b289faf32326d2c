"""Offers the event sensor in Python: frames in, events out, on the device where the frames are."""

from __future__ import annotations

import json
import operator
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from evis.config.suggestions import environments_there
from evis.gpu.exchange import NUMPY, as_kind, as_warp, kind_of
from evis.gpu.host_copies import host_array
from evis.gpu.saved_arrays import joined, part_of
from evis.media.frames.source import OF_SECONDS
from nodes.event_sensor.effects import check_given
from nodes.event_sensor.input.further import Further
from nodes.event_sensor.make import make_sensor
from nodes.event_sensor.parameters import LARGEST_SIDE, frames_only, is_own_model, resolve_sensor

_OWNER = "event sensor"
STATE_VERSION = 1
"""Of the dict that `EventSensor.state` gives: another one where its names or their meaning change."""
_ALWAYS = ("height", "width", "envs", "colour", "parameters", "seed", "until", "batched", "episodes")
"""What every state has beside its version."""


@dataclass(frozen=True)
class SensorEvents:
    """Holds the events of one call, sorted by environment, t, y, x; arrays are of the frames' kind, on their device.

    t: int64 [n, ns]. x, y: uint16 [n]. p: uint8 [n], 1 = ON. c: uint8 [n], 0 R, 1 G, 2 B, None without colour.
    env_offsets: int64 [E + 1], numpy, events of environment e are [offsets[e], offsets[e + 1]); None where the frames
    had no axis E. start_ns, end_ns: all events up to here have been given, (start_ns, end_ns].
    """

    t: Any
    x: Any
    y: Any
    p: Any
    c: Any
    env_offsets: np.ndarray | None
    start_ns: int
    end_ns: int
    height: int
    width: int

    def __len__(self) -> int:
        return len(self.t)


class EventSensor:
    """Turns frames of linear luminance into events, as the node `event_sensor` of a graph does, byte for byte.

    The state of every pixel is kept from call to call, so that a video may come frame by frame or at once. Nothing is
    differentiated. What does not fit is counted (`counts`), not passed over.

        sensor = evis.EventSensor(260, 346, threshold=0.15, refractory_us=100)
        events = sensor(frames, t)      # float32 [T, 260, 346], int64 [T] in ns
        events.t, events.x, events.y, events.p

    Args:
        height, width: pixels.
        envs: E, parallel sensors; environment e has the random numbers of a single sensor with seed + e.
        colour: sensors for R, G and B in place of one for luminance.
        device: where it is computed, cpu or cuda:N; None = where the first frames are.
        seed: of the random numbers.
        preset: sensor whose faults to have (ideal, dvs128, davis346, ...), or a YAML file of parameters, `name: value`.
        parameters: those of the node, over the preset's: threshold, threshold_mismatch, refractory_us, leak_rate,
            shot_rate, bandwidth_hz, crossing, ...; docs/event_sensor.md explains them.

    Raises ValueError naming the parameter, the range and the nearest valid name, or why it would change nothing.
    """

    def __init__(
        self,
        height: int,
        width: int,
        envs: int = 1,
        *,
        colour: bool = False,
        device: str | None = None,
        seed: int = 0,
        preset: str | os.PathLike[str] = "ideal",
        **parameters: Any,
    ) -> None:
        self.height, self.width, self.envs = (
            _whole_from_one(name, value, most)
            for name, value, most in (
                ("height", height, LARGEST_SIDE),
                ("width", width, LARGEST_SIDE),
                ("envs", envs, None),
            )
        )
        self.colour, self.seed = colour, _seed(seed)
        self.parameters = _resolved(preset, parameters)
        check_given(parameters, self.parameters)
        self._device = device
        self._sensor: Any = None
        self._until = 0
        self._episodes = np.zeros(self.envs, np.int32)
        self._batched = self.envs > 1
        """Whether the last frames had an axis E, which events of `flush` then have too."""
        if device is None:  # parameters that do not go together are told now, not at the first frame
            make_sensor(self.parameters, (1, 1), colour=colour, device="cpu", seed=seed)
        else:
            self._sensor = self._made(device)

    def _made(self, device: str, seed: int | None = None) -> Any:
        shape, seed = (self.height, self.width), self.seed if seed is None else seed
        return make_sensor(self.parameters, shape, self.envs, colour=self.colour, device=device, seed=seed)

    def __call__(self, frames: Any, t: Any, dlog_dt: Any = None, further: Further | None = None) -> SensorEvents:
        """Takes T frames and gives the events between the last frame before them and the last of them.

        The first frame after a reset is the reference and fires nothing. With look-ahead (crossing monotone or cubic)
        events come one frame later, the last ones by `flush`.

        Args:
            frames: float32 [T, H, W] or [E, T, H, W], linear luminance; in colour with an axis of 3 behind. numpy, a
                PyTorch tensor, a Warp array, or anything with DLPack; on the sensor's device they are not copied.
            t: int64 [T], ns, ascending from call to call.
            dlog_dt: as frames, d ln I / dt [1/s], for crossing=hermite.
            further: samples of single pixels between these frames, and between the last frame before and the first of
                them; arrays of any of the kinds that frames may be.

        Returns:
            Events of the frames' kind, on their device: a tensor gives tensors. Raises ValueError.
        """
        kind, images, self._batched = self._taken(frames, "frames")
        if dlog_dt is not None and self.parameters["crossing"] != "hermite":
            raise ValueError("dlog_dt has no effect: crossing is not hermite; leave it out, or take crossing=hermite")
        slopes = None if dlog_dt is None else self._taken(dlog_dt, "dlog_dt")[1]
        device = images.device if isinstance(images, wp.array) else None
        if self._sensor is None:
            self._sensor = self._made("cpu" if device is None else str(device))
        stamps = _stamps(t)
        if not len(stamps) or len(stamps) != images.shape[1]:
            raise ValueError(
                f"frames are {list(np.shape(frames))} with {len(stamps)} stamps; a call takes one frame or more, and a "
                "stamp for each"
            )
        more: dict[str, Any] = {} if slopes is None else {"dlog_dt": slopes}
        if further is not None:
            more["further"] = Further(*(_in_place(a) for a in (further.first, further.offset, further.value)))
        if self._is_peer:
            if further is not None:
                raise ValueError(f"{_OWNER} got further samples between the frames, but {frames_only(self.parameters)}")
            on_host = images.numpy() if isinstance(images, wp.array) else images
            made = self._sensor.process(on_host, stamps, self._episodes, **more)
            self._until = int(stamps[-1])
            return self._given(_columns(made), made.env_offsets, kind, device)
        count = self._sensor.advance(images, stamps, self._episodes, **more)
        self._until = self._sensor.stamp
        return self._given(self._read(count), self._sensor.env_offsets(), kind, device)

    def flush(self) -> SensorEvents:
        """Returns the events that look-ahead and readout hold back, at the end of a stream, as numpy arrays.

        Those of the readout may be later than the last frame; `end_ns` then is the time of the last of them.
        """
        if self._sensor is None:
            raise ValueError(f"{_OWNER}: there is nothing to flush; it has had no frame")
        if self._is_peer:
            made = self._sensor.flush()
            return self._given(_columns(made), made.env_offsets, NUMPY, None)
        columns = self._read(self._sensor.finish())
        self._until = int(host_array(columns["t"]).max(initial=self._sensor.stamp))
        return self._given(columns, self._sensor.env_offsets(), NUMPY, None)

    def reset(self, seed: int | None = None, envs: Iterable[int] | None = None) -> None:
        """Begins anew: the next frame is the reference. What `flush` would have given is forgotten.

        Args:
            seed: as a new sensor with this seed; None = the same pixels draw other noise, as in a further episode of a
                graph. Time may begin anew where all environments do.
            envs: numbers of the environments that begin anew while the others go on; None = all.

        Raises ValueError.
        """
        if envs is None:
            new_seed = self.seed if seed is None else _seed(seed)
            self._episodes += 1
            self.seed = new_seed
            if seed is not None:
                self._episodes[:] = 0
                self._sensor = None if self._device is None else self._made(self._device)
            elif self._sensor is not None and not self._is_peer:
                self._sensor.finish()
            return
        if seed is not None:
            raise ValueError(f"{_OWNER}: a seed is that of all environments; reset them all, or give none")
        # What a run holds comes with it, which a sensor alone does without.
        from evis.client.resets import environments_of

        try:
            chosen = np.unique(environments_of([*envs] if isinstance(envs, Iterable) else envs))
        except ValueError as error:
            raise ValueError(f"{_OWNER}: {error}") from None
        if len(chosen) and chosen[-1] >= self.envs:
            raise ValueError(f"{_OWNER}: no environment {chosen[-1]}; {environments_there(self.envs)}")
        self._episodes[chosen] += 1

    def state(self) -> dict[str, Any]:
        """Gives everything that the next events hang on, so that `restore` goes on from here with the same bytes.

        A plain dict of numpy arrays, numbers and strings, all of them copies: `np.savez(path, **sensor.state())` writes
        it, `sensor.restore(np.load(path))` reads it, without pickle. Of a sensor that has had no frame it is small.
        """
        kept = {"version": STATE_VERSION, **self._kind(), "seed": _wrapped(self.seed), "until": self._until}
        kept |= {"batched": self._batched, "episodes": self._episodes.copy()}
        if self._sensor is None:
            return kept
        return {**kept, "device": self._placed(), **joined({"sensor": self._sensor.state()})}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Goes on from a `state`, whatever came before: with the bytes of the sensor that gave it, seed included.

        Args:
            state: of a sensor of the same size and parameters, on the same kind of device; its own or another's, also
                as `np.load` gives it.

        Raises ValueError naming what does not fit; the sensor is then as it was.
        """
        given = _unpacked(state)
        for name, own in self._kind().items():
            if given[name] != own:
                raise ValueError(f"{_OWNER}: {_unlike(name, given[name], own)}")
        restored, seed = None, int(given["seed"])
        if "device" in given:
            device, own = str(given["device"]), self._device or (self._sensor and self._placed())
            if own and own.partition(":")[0] != device.partition(":")[0]:
                raise ValueError(
                    f"{_OWNER}: the state is of a sensor on {device}, and this one is on {own}; take device={device!r}"
                )
            restored = self._made(own or device, seed)
            try:
                restored.restore(part_of(given, "sensor"))
            except (ValueError, KeyError) as error:
                why = f"it lacks sensor.{error.args[0]}" if isinstance(error, KeyError) else str(error)
                raise ValueError(f"{_OWNER}: the state is damaged, or of another version of EVIS: {why}") from None
        elif self._device is not None:
            restored = self._made(self._device, seed)
        self._sensor, self.seed = restored, seed
        self._until, self._batched = int(given["until"]), bool(given["batched"])
        self._episodes = np.array(given["episodes"], np.int32)

    def _kind(self) -> dict[str, Any]:
        """Gives what a state must have in common with the sensor that goes on from it."""
        return {
            "height": self.height,
            "width": self.width,
            "envs": self.envs,
            "colour": self.colour,
            "parameters": json.dumps(self.parameters, sort_keys=True),
        }

    def _placed(self) -> str:
        """Names the device that its pixels are on; other event models than its own are on the CPU."""
        return "cpu" if self._is_peer else self._sensor.device

    def counts(self) -> dict[str, int]:
        """Counts samples and events set aside so far, by reason: nonfinite, clipped, dropped, ..."""
        return {} if self._sensor is None else dict(self._sensor.counts())

    def __getstate__(self) -> dict[str, Any]:
        """Gives what a copy or a pickle is made of, as long as no pixel has a state."""
        if self._sensor is not None:
            raise TypeError(f"{_OWNER}: its pixels cannot be copied or pickled; make one with the same arguments")
        return self.__dict__

    # -- between the caller's arrays and the sensor's ----------------------------------------------------------------

    @property
    def _is_peer(self) -> bool:
        return not is_own_model(self.parameters["model"])

    def _taken(self, frames: Any, name: str) -> tuple[str, Any, bool]:
        """Gives the caller's kind of array, frames as [E, T, H, W(, 3)] of numpy or Warp, and whether E was given."""
        kind = kind_of(frames)
        if kind == NUMPY:
            frames = np.asarray(frames)
        _check_type(frames, kind, name)
        of_three = self.colour and not _is_colour(frames)
        size = (self.height, self.width, *((3,) if of_three else ()))
        shape = tuple(frames.shape)
        before = shape[: max(len(shape) - len(size), 0)]
        batched = len(before) == 2
        enough = before[0] == self.envs if batched else (self.envs, len(before)) == (1, 1)
        if shape[len(before) :] != size or not enough:
            raise ValueError(f"{name} have the shape {list(shape)}; they must be {self._wanted(shape)}")
        if isinstance(frames, wp.array) and not frames.is_contiguous:
            frames = frames.contiguous()
        if not batched:
            frames = frames.reshape((1, *frames.shape))
        if kind == NUMPY:
            return kind, frames, batched
        return kind, as_warp(frames, wp.vec3f if of_three and not isinstance(frames, wp.array) else None), batched

    def _wanted(self, shape: tuple[int, ...]) -> str:
        """Says what the shape must be, and what else could be meant by the one that is given."""
        size = f"T, {self.height}, {self.width}{', 3' if self.colour else ''}"
        ways = [f"[{self.envs}, {size}]"] + ([f"[{size}]"] if self.envs == 1 else [])
        sides, hint = (self.height, self.width), ""
        if shape[-3:] == (*sides, 3) and not self.colour:
            hint = ", or in R, G and B with colour=True"
        elif shape[-3:] == (*sides, 4):
            hint = "; frames[..., :3] leaves out alpha"
        elif shape[-3:] == (*sides, 1):
            hint = "; frames[..., 0] leaves out the last axis"
        elif len(shape) > 3 and shape[-3:] == (3, *sides):
            hint = "; np.moveaxis(frames, -3, -1) puts colours last"
        return " or ".join(ways) + hint

    def _read(self, count: int) -> dict[str, Any]:
        """Reads the sensor's last events, on the device where it has them."""
        gpu, types = self._sensor.on_gpu, self._sensor.columns()
        out: dict[str, Any] = {name: np.empty(count, dtype) for name, dtype in types.items()}
        if gpu is not None:
            out = {n: wp.empty(count, dtype=wp.dtype_from_numpy(d), device=gpu) for n, d in types.items()}
        self._sensor.read(out)
        return out

    def _given(self, columns: dict[str, Any], offsets: np.ndarray, kind: str, device: Any) -> SensorEvents:
        """Gives events as the caller's kind of array, on the frames' device; None = the host."""
        out = {name: _moved(column, kind, device) for name, column in columns.items()}
        return SensorEvents(
            out["t"], out["x"], out["y"], out["p"], out.get("c"), np.asarray(offsets) if self._batched else None,
            int(self._sensor.t_base), self._until, self.height, self.width,
        )  # fmt: skip


def _whole_from_one(name: str, value: Any, most: int | None) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1 or (most and value > most):
        upwards = f"to {most}" if most else "or more"
        raise ValueError(f"{_OWNER}: {name} is {value!r}; it must be a whole number, 1 {upwards}")
    return int(value)


def _seed(value: Any) -> int:
    """Checks a seed, before the first frame asks for random numbers. Raises ValueError."""
    try:
        return operator.index(value)
    except TypeError:
        raise ValueError(f"{_OWNER}: seed is {value!r:.60}; it must be a whole number") from None


def _wrapped(seed: int) -> int:
    """Gives the seed within 64 bits that has the same random numbers."""
    return (seed + (1 << 63)) % (1 << 64) - (1 << 63)


def _unpacked(state: Any) -> dict[str, Any]:
    """Reads a state as `EventSensor.state` gave it, whose numbers np.savez has made arrays of. Raises ValueError."""
    if not isinstance(state, Mapping) or "version" not in state:
        raise ValueError(f"{_OWNER}: {state!r:.60} is no state of a sensor; sensor.state() gives one")
    given: dict[str, Any] = {name: state[name] for name in state}
    given = {n: v.item() if isinstance(v, np.ndarray) and not v.ndim else v for n, v in given.items()}
    if given["version"] != STATE_VERSION:
        raise ValueError(
            f"{_OWNER}: the state has version {given['version']}, and this EVIS reads version {STATE_VERSION}; run "
            "from the start, or with the EVIS that has written it"
        )
    if lacking := [name for name in _ALWAYS if name not in given]:
        raise ValueError(f"{_OWNER}: the state is damaged: it lacks {lacking[0]}")
    return given


def _unlike(name: str, given: Any, own: Any) -> str:
    """Says in what a state is of another sensor, and what helps."""
    if name == "parameters":
        theirs, ours = json.loads(given), json.loads(own)
        name = next(n for n in sorted({*theirs, *ours}) if theirs.get(n) != ours.get(n))
        given, own = theirs.get(name), ours.get(name)
    return f"the state is of a sensor with {name}={given!r}, and this one has {own!r}; make one that is alike"


def _in_place(values: Any) -> Any:
    """Gives an array of the caller's as the sensor takes it: numpy, or Warp's."""
    return values if kind_of(values) == NUMPY else as_warp(values)


def _columns(made: Any) -> dict[str, Any]:
    return {name: getattr(made, name) for name in ("t", "x", "y", "p")}


def _moved(column: Any, kind: str, device: Any) -> Any:
    if kind == NUMPY:
        return host_array(column)
    there: Any = wp.array(column, device="cpu", copy=False) if isinstance(column, np.ndarray) else column
    return as_kind(there if there.device == device else there.to(device), kind)


def _check_type(frames: Any, kind: str, name: str) -> None:
    """Raises ValueError for numbers that are no luminance; numpy's of any length are converted, others lie as they
    are."""
    own = getattr(frames, "dtype", None)
    if own is None:  # of what speaks DLPack alone, the sensor learns it from there
        return
    told = own.__name__ if isinstance(frames, wp.array) else str(own).rpartition(".")[2]
    if told in ("float32", "vec3f") or (kind == NUMPY and own.kind == "f"):
        return
    coded = told.startswith(("uint", "int"))
    remedy = "evis.media.colour.linear_from_srgb(codes / 255) makes it of 8 bits" if coded else "convert them"
    raise ValueError(f"{name} are {told}; they must be linear luminance in float32: {remedy}")


def _is_colour(frames: Any) -> bool:
    """Tells whether frames have the axis of colours inside, as a Warp array of vec3f has."""
    return isinstance(frames, wp.array) and frames.dtype is wp.vec3f


def _stamps(t: Any) -> np.ndarray:
    stamps = np.asarray(t) if kind_of(t) == NUMPY else as_warp(t).numpy()
    if stamps.dtype.kind not in "iu" or stamps.ndim != 1:
        how = f"; {OF_SECONDS}" if stamps.dtype.kind == "f" else ""
        raise ValueError(f"t is {stamps.dtype} {list(stamps.shape)}; it must be whole nanoseconds, int64 [T]{how}")
    if len(stamps) and stamps.max() > np.iinfo(np.int64).max:
        raise ValueError(f"t reaches {stamps.max()}, more than int64 nanoseconds can hold")
    return stamps.astype(np.int64, copy=False)


def _resolved(preset: str | os.PathLike[str], given: dict[str, Any]) -> dict[str, Any]:
    """Gives all parameters: given ones over the preset's, which may be a file's."""
    name: Any = os.fspath(preset) if isinstance(preset, os.PathLike) else preset
    return resolve_sensor(_OWNER, name, given)
