"""Holds the events of a sensor's last call until they are read."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from nodes.event_sensor.input.batch import Batch
from nodes.event_sensor.readout.packet import merged

if TYPE_CHECKING:
    from nodes.event_sensor.readout.device_events import Pending
    from nodes.event_sensor.readout.readout import Readout


class LastEvents:
    """Holds the events of the last call: in the list that the kernels write or, where they have been through the
    readout or came in parts, in columns on the host.

    event_list: cpu.event_list.HostEventList or cuda.event_list.DeviceEventList. readout: what delays events on their
    way out, None where nothing does. columns: those of an event, and their dtypes. envs: E. all_signal: nothing but
    light makes events, so that the list has no column `signal`, in which all of them are 1.
    """

    def __init__(
        self, event_list: Any, readout: Readout | None, columns: dict[str, type], envs: int, all_signal: bool
    ) -> None:  # fmt: skip
        self.columns = columns
        self._list, self._readout, self._envs, self._all_signal = event_list, readout, envs, all_signal
        self._on_host: tuple[dict[str, np.ndarray], np.ndarray] | None = None
        """Columns and offsets of the events, where these are not those of the list."""

    def __len__(self) -> int:
        return len(self._list) if self._on_host is None else len(self._on_host[0]["t"])

    def fill(self, parts: Iterable[tuple[Batch, int]], begins: np.ndarray) -> None:
        """Takes the events of a call. parts: of its frames, with the stamp [ns] that each ends at. begins: bool [E],
        environments whose episode begins with the first of them."""
        found: list[tuple[dict[str, np.ndarray], np.ndarray]] = []
        first = True
        for batch, stamp in parts:
            if not first:
                found.append(self._taken())  # of the part before, whose list is written anew
                begins = np.zeros_like(begins)
            first = False
            self._fill_part(batch, begins, stamp)
        if found:
            self._on_host = merged([*found, self._taken()], self._envs)

    def _fill_part(self, batch: Batch, begins: np.ndarray, stamp: int) -> None:
        self._list.fill(batch, stamp)
        self._on_host = None
        if self._readout is not None:
            out: dict[str, np.ndarray] = {n: np.empty(len(self._list), dtype) for n, dtype in self.columns.items()}
            self.read_call(self._list, out)
            self._on_host = self._readout.apply_batch(out, self._list.env_offsets(), batch, begins, stamp)

    def submit(self, batch: Batch, stamp: int, defer: bool) -> Pending:
        """Begins a call whose events stay on the GPU; see DeviceEventList.submit."""
        self._on_host = None
        pending: Pending = self._list.submit(batch, stamp, defer=defer)
        return pending

    def clear(self) -> None:
        """Forgets the events."""
        self._list.clear()
        nothing: dict[str, np.ndarray] = {name: np.zeros(0, dtype) for name, dtype in self.columns.items()}
        self._on_host = nothing, np.zeros(self._envs + 1, np.int64)

    def add_late(self) -> None:
        """Adds what has still to leave the readout, at the end of a stream."""
        rest = None if self._readout is None else self._readout.flush()
        if rest is not None:
            assert self._on_host is not None
            self._on_host = merged([self._on_host, rest], self._envs)

    @property
    def on_host(self) -> bool:
        """Tells whether the events are in columns on the host, and not in the list."""
        return self._on_host is not None

    def env_offsets(self) -> np.ndarray:
        """Returns int64 [E + 1], where the events of each environment begin and end."""
        offsets: np.ndarray = self._list.env_offsets() if self._on_host is None else self._on_host[1]
        return offsets

    def read(self, out: Any) -> None:
        """Writes the events to arrays of `columns`, name -> array: of numpy, or Warp's where the list is on a GPU."""
        if self._on_host is None:
            self.read_call(self._list, out)
        else:
            for name, column in self._on_host[0].items():
                out[name][:] = column

    def read_call(self, events: Any, out: Any) -> None:
        """Writes the events of a list, or of a call that `submit` has begun, to arrays of `columns`, as `read` does."""
        if self._all_signal:
            signal: Any = out["signal"]
            signal.fill(1) if isinstance(signal, np.ndarray) else signal.fill_(1)
            out = {name: column for name, column in out.items() if name != "signal"}
        events.read(out)

    def _taken(self) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Copies the events to the host: columns and offsets."""
        own: dict[str, np.ndarray] = {name: np.empty(len(self), dtype) for name, dtype in self.columns.items()}
        self.read(own)
        return own, self.env_offsets()
