"""Holds the container of events that every decoder fills and every encoder reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

STANDARD_GRAVITY = 9.80665
"""The g in which sensors and files give accelerations [m/s^2]."""

# arrays without elements are shared: there is nothing in them that could be changed
_NONE: dict[Any, np.ndarray] = {d: np.empty(0, d) for d in (np.int64, np.uint16, np.uint8, np.float64)}
_NO_AXES = np.empty((0, 3))


def _none(dtype: Any) -> Any:
    return field(default_factory=lambda: _NONE[dtype])


@dataclass(slots=True)
class Triggers:
    """Holds trigger edges: t int64 [ns], id uint8 (channel), value uint8 (1 = rising); all of shape [m]."""

    t: np.ndarray = _none(np.int64)
    id: np.ndarray = _none(np.uint8)
    value: np.ndarray = _none(np.uint8)

    def __len__(self) -> int:
        return len(self.t)


@dataclass(slots=True)
class Imu:
    """Holds inertial samples in the camera's frame, gravity included; what a sensor did not send is NaN.

    t int64 [n, ns], acceleration float64 [n, 3, m/s^2], angular_velocity float64 [n, 3, rad/s], temperature float64
    [n, deg C].
    """

    t: np.ndarray = _none(np.int64)
    acceleration: np.ndarray = field(default_factory=lambda: _NO_AXES)
    angular_velocity: np.ndarray = field(default_factory=lambda: _NO_AXES)
    temperature: np.ndarray = _none(np.float64)

    def __len__(self) -> int:
        return len(self.t)


@dataclass(slots=True)
class Frame:
    """Holds one image of the sensor: pixels uint8 or uint16 [h, w] (grey) or [h, w, 3] (RGB), times in ns.

    t_ns: start of the readout; end_ns: its end. x0, y0: place of a region of interest on the sensor.
    """

    t_ns: int
    pixels: np.ndarray
    exposure_start_ns: int
    exposure_end_ns: int
    x0: int = 0
    y0: int = 0
    end_ns: int = 0

    @property
    def exposure_ns(self) -> int:
        """Returns the length of the exposure."""
        return self.exposure_end_ns - self.exposure_start_ns

    @property
    def middle_ns(self) -> int:
        """Returns the middle of the exposure; the start of the readout where there is no exposure."""
        return (self.exposure_start_ns + self.exposure_end_ns) // 2 or self.t_ns

    def shifted(self, by_ns: int) -> Frame:
        """Returns the frame with all of its times later by `by_ns`; its pixels are not copied."""
        times = {
            name: getattr(self, name) + by_ns for name in ("t_ns", "end_ns", "exposure_start_ns", "exposure_end_ns")
        }
        return replace(self, **times)


@dataclass(slots=True)
class Events:
    """Holds events in the order in which the sensor sent them.

    t int64 [ns], x uint16 (column), y uint16 (row), p uint8 (1 = ON, 0 = OFF), c uint8 or None (0 R, 1 G, 2 B); all of
    shape [n]. Triggers, inertial samples and frames have their own times; their place among the events is not kept.
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    c: np.ndarray | None = None
    triggers: Triggers = field(default_factory=Triggers)
    imu: Imu = field(default_factory=Imu)
    frames: list[Frame] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, part: slice | np.ndarray) -> Events:
        """Returns the events of a slice, as views, or of an index, without triggers, inertial samples and frames."""
        c = None if self.c is None else self.c[part]
        return Events(self.t[part], self.x[part], self.y[part], self.p[part], c)

    @property
    def has_aside(self) -> bool:
        """Tells whether there are triggers, inertial samples or frames."""
        return bool(len(self.triggers) or len(self.imu) or self.frames)

    def without_events(self) -> Events:
        """Returns the triggers, inertial samples and frames alone, which are not copied."""
        return Events.empty().beside(self)

    def aside(self, start_ns: int | None, stop_ns: int | None) -> Events:
        """Returns the triggers, inertial samples and frames in [start, stop) [ns], without events; None = no such
        bound."""
        part = Events.empty()

        def inside(t: Any) -> Any:
            return (start_ns is None or t >= start_ns) & (stop_ns is None or t < stop_ns)

        for name in ("triggers", "imu"):
            samples = getattr(self, name)
            keep = np.broadcast_to(inside(samples.t), len(samples))
            setattr(part, name, type(samples)(*(getattr(samples, slot)[keep] for slot in samples.__slots__)))
        part.frames = [frame for frame in self.frames if inside(frame.t_ns)]
        return part

    def beside(self, aside: Events) -> Events:
        """Returns these events with the triggers, inertial samples and frames of `aside`."""
        return Events(self.t, self.x, self.y, self.p, self.c, aside.triggers, aside.imu, aside.frames)

    def shifted(self, by_ns: int) -> Events:
        """Returns these events with all times later by `by_ns`, those of triggers, inertial samples and frames too."""
        return replace(
            self,
            t=self.t + by_ns,
            triggers=replace(self.triggers, t=self.triggers.t + by_ns),
            imu=replace(self.imu, t=self.imu.t + by_ns),
            frames=[frame.shifted(by_ns) for frame in self.frames],
        )

    @staticmethod
    def empty() -> Events:
        """Makes empty arrays: no events."""
        return Events(_NONE[np.int64], _NONE[np.uint16], _NONE[np.uint16], _NONE[np.uint8])

    @staticmethod
    def of(t: Any, x: Any, y: Any, p: Any, c: Any = None) -> Events:
        """Makes events from integer sequences of equal length. Raises ValueError where a value does not fit its
        type.
        """
        arrays = [_fit("t", t, np.int64), _fit("x", x, np.uint16), _fit("y", y, np.uint16), _fit("p", p, np.uint8)]
        if len({a.shape for a in arrays}) != 1 or arrays[0].ndim != 1:
            shapes = ", ".join(f"{n} {list(a.shape)}" for n, a in zip("txyp", arrays))
            raise ValueError(f"event arrays must be flat and of equal length, not {shapes}")
        if len(arrays[3]) and arrays[3].max() > 1:
            raise ValueError("p must be 0 (OFF) or 1 (ON)")
        colour = None if c is None else _fit("c", c, np.uint8)
        if colour is not None and colour.shape != arrays[0].shape:
            raise ValueError(f"c has {colour.size} values for {len(arrays[0])} events")
        return Events(arrays[0], arrays[1], arrays[2], arrays[3], colour)

    @staticmethod
    def concatenate(parts: Sequence[Events]) -> Events:
        """Returns all parts one after the other; colour is kept where every part that has events has it.

        Where one part alone has events, they are not copied. Raises ValueError when only some of the parts have colour.
        """
        if len(parts) == 1:
            return parts[0]
        filled = [e for e in parts if len(e)]
        result = Events.empty()
        if len(filled) == 1:
            result = filled[0][:]
        elif filled:
            t, x, y, p = (np.concatenate([getattr(e, n) for e in filled]) for n in "txyp")
            result = Events(t, x, y, p)
            colours = [e.c for e in filled if e.c is not None]
            if colours:
                if len(colours) != len(filled):
                    raise ValueError("events with and without colour cannot be joined")
                result.c = np.concatenate(colours)
        edges = [e.triggers for e in parts if len(e.triggers)]
        if edges:
            result.triggers = Triggers(*(np.concatenate([getattr(g, n) for g in edges]) for n in ("t", "id", "value")))
        samples = [e.imu for e in parts if len(e.imu)]
        if samples:
            names = ("t", "acceleration", "angular_velocity", "temperature")
            result.imu = Imu(*(np.concatenate([getattr(m, n) for m in samples]) for n in names))
        result.frames = [frame for e in parts for frame in e.frames]
        return result


def _fit(name: str, value: Any, dtype: Any) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype == dtype:
        return array
    if array.dtype == np.bool_ or not array.size:
        return array.astype(dtype)
    limits = np.iinfo(dtype)
    if array.dtype.kind not in "iu":
        raise ValueError(f"{name} is {array.dtype}, must be whole numbers ({np.dtype(dtype)})")
    if array.min() < limits.min or array.max() > limits.max:
        raise ValueError(f"{name} runs from {array.min()} to {array.max()}, must fit {np.dtype(dtype)}")
    return array.astype(dtype)
