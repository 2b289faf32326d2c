"""Checks the input of every representation: the events' columns, environments, sensor size and time window."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from evis.events.representations.column_kernels import WIDENED, span_kernel, widen_kernel
from evis.gpu.exchange import as_kind, as_warp, kind_of

NEVER = -(2**63) + 1
"""Time before all times [ns]."""
POLARITIES = ("signed", "split", "merged")
NATIVE = {"x": wp.uint16, "y": wp.uint16, "p": wp.uint8}
"""Types that the kernels take as they are; others are widened to int32."""
TYPES: tuple[dict[str, Any], ...] = (
    {name: wp.array(dtype=dtype) for name, dtype in NATIVE.items()},
    {name: wp.array(dtype=wp.int32) for name in NATIVE},
)
"""Arguments of a kernel over events, in the two types it is compiled for."""


class Representation(NamedTuple):
    """Holds a representation of events, and how many events lay outside its time window and its array.

    values: float32 or int32, the images; leading axis E where the events have environments. outside: int64 [2] or
    [E, 2], events outside the time window, and events inside it but outside the array (which are not counted twice).
    Both are numpy arrays, Warp arrays or PyTorch tensors, as the events were, on the same device.
    """

    values: Any
    outside: Any


class Columns:
    """Holds the caller's events as Warp arrays t, x, y, p, with their environments and the sensor's size.

    events: attributes or items t [n, int64, ns], x, y [n, whole numbers], p [n, above 0 = ON]; env_offsets
    [E + 1], if it has such, delimits environments. height, width: None = the events' own. Raises ValueError.
    """

    def __init__(self, events: Any, height: int | None, width: int | None) -> None:
        given = {name: _column(events, name) for name in ("t", "x", "y", "p")}
        self.kind = kind_of(given["t"])
        if self.kind == "numpy":
            given["t"] = _whole_ns(given["t"])
        arrays = {name: as_warp(values) for name, values in given.items()}
        self.t: Any = arrays["t"]
        self.count, self.device = len(self.t), self.t.device
        _check(arrays, self.device)
        native = all(arrays[name].dtype is dtype for name, dtype in NATIVE.items())
        self.x, self.y, self.p = (arrays[n] if native else self._widened(arrays[n]) for n in NATIVE)
        offsets = _optional(events, "env_offsets")
        self.batched = offsets is not None
        self.offsets = _offsets(offsets, self.count)
        self.envs = len(self.offsets) - 1
        self.height, self.width = _side(events, "height", height), _side(events, "width", width)
        self.outside: Any = wp.zeros((self.envs, 2), dtype=wp.int64, device=self.device)

    def _widened(self, values: Any) -> Any:
        wide: Any = wp.empty(len(values), dtype=wp.int32, device=self.device)
        wp.launch(widen_kernel, len(values), inputs=[values], outputs=[wide], device=self.device)
        return wide

    @property
    def per_event(self) -> list[Any]:
        """Returns the columns and the environments, as kernels take them."""
        return [self.t, self.x, self.y, self.p, wp.array(self.offsets, dtype=wp.int64, device=self.device)]

    def window(self, window: tuple[Any, Any] | None) -> Any:
        """Returns the first and last time [ns], int64 [E, 2] on the device: those given, or those of the events."""
        if window is None:
            span: Any = wp.array(np.tile([-NEVER, NEVER], (self.envs, 1)), dtype=wp.int64, device=self.device)
            offsets: Any = wp.array(self.offsets, dtype=wp.int64, device=self.device)
            wp.launch(span_kernel, self.count, inputs=[self.t, offsets], outputs=[span], device=self.device)
            return span
        try:
            t0, t1 = window
        except (TypeError, ValueError):
            raise ValueError(f"the window is {window!r:.60}; it must be (t0, t1), two times in ns") from None
        first, last = self.times(t0, "first"), self.times(t1, "last")
        if (first > last).any():
            env = int(np.argmax(first > last))
            raise ValueError(f"the window begins at {first[env]} ns, after its end at {last[env]} ns")
        return wp.array(np.stack([first, last], 1), dtype=wp.int64, device=self.device)

    def times(self, value: Any, name: str) -> np.ndarray:
        """Returns one time for each environment, int64 [E], of one for all or one for each. Raises ValueError."""
        times = np.asarray(value)
        if times.dtype.kind not in "iu" or times.shape not in ((), (self.envs,)):
            raise ValueError(
                f"the window's {name} time must be whole ns, one or one for each of {self.envs} environments, "
                f"not {times.dtype} {list(times.shape)}"
            )
        return np.broadcast_to(times.astype(np.int64), (self.envs,))

    def result(self, values: Any, shape: tuple[int, ...]) -> Representation:
        """Returns [E, *shape] as the caller's kind of array, without the axis E where the events have none."""
        outside: Any = self.outside
        if self.batched:
            values = values.reshape((self.envs, *shape))
        else:
            values, outside = values.reshape(shape), outside.reshape((2,))
        return Representation(as_kind(values, self.kind), as_kind(outside, self.kind))


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raises ValueError, which names the choices, for any other value."""
    if value not in choices:
        raise ValueError(f"{name} is {value!r}; it must be {', '.join(choices[:-1])} or {choices[-1]}")


def check_flag(name: str, value: bool) -> None:
    """Raises ValueError unless the value is True or False: any text would count as true."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} is {value!r:.60}; it must be True or False")


def check_positive(name: str, value: int) -> None:
    """Raises ValueError unless the value is a whole number above 0."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise ValueError(f"{name} is {value!r}; it must be a whole number, 1 or more")


def _optional(events: Any, name: str) -> Any:
    found = getattr(events, name, None)
    return events.get(name) if found is None and isinstance(events, Mapping) else found


def _column(events: Any, name: str) -> Any:
    found = getattr(events, name, None)
    if found is None:
        try:
            found = events[name]
        except (KeyError, IndexError, TypeError, ValueError):
            raise ValueError(f"events have no '{name}'; they must have t, x, y and p") from None
    return found


def _whole_ns(t: Any) -> np.ndarray:
    t = np.asarray(t)
    if t.size and t.dtype.kind not in "iu":
        raise ValueError(f"t is {t.dtype}, must be whole nanoseconds (int64)")
    return t.astype(np.int64, copy=False)


def _check(arrays: Mapping[str, Any], device: Any) -> None:
    for name, array in arrays.items():
        if array.ndim != 1 or len(array) != len(arrays["t"]):
            shapes = ", ".join(f"{n} {list(a.shape)}" for n, a in arrays.items())
            raise ValueError(f"event columns must be flat and of equal length, not {shapes}")
        if array.device != device:
            raise ValueError(f"{name} is on {array.device}, t on {device}; the columns must lie on one device")
        allowed = (wp.int64,) if name == "t" else WIDENED
        if array.dtype not in allowed:
            expected = "whole nanoseconds (int64)" if name == "t" else "whole numbers"
            raise ValueError(f"{name} is {array.dtype.__name__}, must be {expected}")


def _offsets(given: Any, count: int) -> np.ndarray:
    if given is None:
        return np.array([0, count], np.int64)
    offsets = given if isinstance(given, np.ndarray) else as_warp(given).numpy()
    if offsets.ndim != 1 or len(offsets) < 2 or offsets.dtype.kind not in "iu":
        raise ValueError(f"env_offsets must be whole numbers [E + 1], not {offsets.dtype} {list(offsets.shape)}")
    if offsets[0] != 0 or offsets[-1] != count or (offsets[1:] < offsets[:-1]).any():
        raise ValueError(f"env_offsets must ascend from 0 to the number of events, {count}")
    return offsets.astype(np.int64)


def _side(events: Any, name: str, given: int | None) -> int:
    size = _optional(events, name) if given is None else given
    if size is None:
        raise ValueError(f"the events do not say their {name}; give {name}=")
    check_positive(name, size)
    return int(size)
