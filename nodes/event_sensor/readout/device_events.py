"""Holds events on the sensor's device, copied to the host only where asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.host_copies import copying_stream
from nodes.event_sensor.readout.packet import Events

CALLS = 4
"""Calls in flight at most, and how many calls later a call's arrays are used again."""


class DeviceEvents:
    """Holds the sorted events of one call: Warp arrays t int64 [ns], x, y uint16, p uint8, c uint8 or None, all
    [count], and `signal` as of Events where keys say what noise made.

    env_offsets: int64 [E + 1], on the host. t_base, stamp: the events lie in (t_base, stamp]. The arrays belong to the
    sensor, which writes others into them CALLS calls later; reading them through this object then raises ValueError.
    `copy` and `numpy` give arrays that stay. ends: of one environment, ascending stamps int64 [K] ns and the number of
    events up to each, where they are known. settled: the arrays are written, so that they can be copied to the host
    while the device works on what was launched later.
    """

    def __init__(
        self,
        columns: dict[str, wp.array],
        count: int,
        env_offsets: np.ndarray,
        span: tuple[int, int],
        alive: Callable[[], bool] = lambda: True,
        ends: tuple[np.ndarray, np.ndarray] | None = None,
        settled: bool = False,
    ) -> None:
        self._columns, self._alive, self._ends, self._settled = columns, alive, ends, settled
        self.count, self.env_offsets = count, env_offsets
        self.t_base, self.stamp = span

    @staticmethod
    def of(events: Events, device: Any, span: tuple[int, int]) -> DeviceEvents:
        """Returns the events of the host on a device; on a CPU the arrays are shared."""
        names = ("t", "x", "y", "p", "c", "signal")
        host = {n: getattr(events, n) for n in names if getattr(events, n) is not None}
        columns: dict[str, wp.array] = {n: wp.array(a, device=device, copy=False) for n, a in host.items()}
        return DeviceEvents(columns, len(events.t), events.env_offsets, span)

    def __len__(self) -> int:
        return self.count

    def column(self, name: str) -> wp.array:
        """Returns a column [count]: t, x, y, p or, with colour, c. Raises ValueError when it is written over."""
        if not self._alive():
            raise ValueError("these events are gone: their arrays hold a later call's; copy() keeps them")
        return self._columns[name][: self.count]

    @property
    def t(self) -> wp.array:
        """Returns the times [ns]."""
        return self.column("t")

    @property
    def x(self) -> wp.array:
        """Returns the columns."""
        return self.column("x")

    @property
    def y(self) -> wp.array:
        """Returns the rows."""
        return self.column("y")

    @property
    def p(self) -> wp.array:
        """Returns the polarities; 1 = ON."""
        return self.column("p")

    @property
    def c(self) -> wp.array | None:
        """Returns the colour channels, None without colour."""
        return self.column("c") if "c" in self._columns else None

    def up_to(self, stamps: Sequence[int]) -> list[int]:
        """Counts, of the events of one environment, those before or at each stamp [ns]."""
        if self._ends is not None:
            known, counts = self._ends
            at = np.minimum(np.searchsorted(known, stamps), len(known) - 1)
            if np.array_equal(known[at], stamps):
                return [int(count) for count in counts[at]]
        times: Any = self.t.numpy()
        return [int(count) for count in np.searchsorted(times, stamps, side="right")]

    def copy(self) -> DeviceEvents:
        """Copies the events to arrays of their own, on the device."""
        columns = {name: wp.clone(self.column(name)) for name in self._columns}
        return DeviceEvents(columns, self.count, self.env_offsets, (self.t_base, self.stamp))

    def read(self, out: Mapping[str, np.ndarray | wp.array]) -> None:
        """Writes the columns to arrays of their length and dtype: numpy's, or the device's, which nobody waits for."""
        device: Any = wp.get_device(self._columns["t"].device)
        to_host = all(isinstance(values, np.ndarray) for values in out.values())
        stream = None
        if device.is_cuda:
            stream = copying_stream(device.alias) if to_host and self._settled else device.stream
        for name, values in out.items():
            if self.count:
                target: Any = values
                if isinstance(values, np.ndarray):
                    target = wp.array(values, copy=False, device="cpu", dtype=self._columns[name].dtype)
                wp.copy(target, self.column(name), stream=stream)
        if to_host and stream is not None:
            wp.synchronize_stream(stream)

    def numpy(self) -> Events:
        """Copies the events to the host."""
        out = {n: np.empty(self.count, wp.dtype_to_numpy(a.dtype)) for n, a in self._columns.items()}
        self.read(out)
        return Events(out["t"], out["x"], out["y"], out["p"], out.get("c"), self.env_offsets, out.get("signal"))


class Pending:
    """Holds a call that was submitted. `result` waits for its events; calls before it are completed too."""

    def __init__(self, collect: Callable[[Pending], DeviceEvents], serial: int, frames: int, span: tuple[int, int],
                 keep: Any) -> None:  # fmt: skip
        self._collect = collect
        self.serial, self.frames, self.span, self.keep = serial, frames, span, keep
        self.events: DeviceEvents | None = None
        self.problem: Callable[[], str] = str
        """Says what was wrong with what it read, "" where nothing was; called once its events are there."""
        self.wrong = ""

    def result(self) -> DeviceEvents:
        """Returns the events of the call, on the device. Raises ValueError where what it read was wrong."""
        if self.events is None:
            self._collect(self)
        assert self.events is not None
        if self.wrong:
            raise ValueError(self.wrong)
        return self.events


@dataclass
class Ready:
    """Holds a call whose events are there already."""

    events: DeviceEvents

    def result(self) -> DeviceEvents:
        """Returns the events of the call, on the device."""
        return self.events
