"""Holds the parameters, results and graphs of one call of a pipeline."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.cuda import call_kernels
from nodes.event_sensor.readout.device_events import Pending


@dataclass(eq=False)
class CallParameters:
    """Holds the parameters of calls of one number of frames, and the graphs that read them.

    host: where they are filled in, in the pinned memory of `staging`; device: where the kernels read them. ends: of one
    environment, the events up to each frame, int64 [K], in `ends_host`, pinned memory that the device writes to.
    """

    frames: int
    host: np.ndarray
    staging: wp.array
    device: wp.array
    ends_host: wp.array
    ends: wp.array
    graphs: dict[Any, Any] = field(default_factory=dict)

    @property
    def stamps(self) -> np.ndarray:
        """Gives the times of the frames, int64 [K] ns."""
        return self.host[call_kernels.STAMPS : call_kernels.STAMPS + self.frames]


@dataclass(eq=False)
class Slot:
    """Holds one call: its parameters and its results. number: its place among the slots."""

    number: int
    counters: wp.array
    head: wp.array
    host: wp.array
    view: np.ndarray
    event: Any
    keys: Any = None
    columns: Any = None
    named: dict[str, wp.array] = field(default_factory=dict)
    by_frames: dict[int, CallParameters] = field(default_factory=dict)
    pending: Pending | None = None
    serial: int = -1

    @property
    def call(self) -> CallParameters:
        """Returns the parameters of the call that it holds."""
        assert self.pending is not None
        return self.by_frames[self.pending.frames]

    def begin(self) -> None:
        """Makes the results ready for a call."""
        self.view[call_kernels.STATUS], self.view[call_kernels.CROWDS] = call_kernels.DONE, 0

    def crowds(self) -> list[tuple[int, int]]:
        """Gives of each crowded bucket its first event and their number; none where there are too many to be known."""
        count, first = int(self.view[call_kernels.CROWDS]), int(call_kernels.CROWDS) + 1
        if count > call_kernels.MOST_CROWDS:
            return []
        parts = self.view[first : first + 2 * count].reshape(count, 2).tolist()
        return [(start, length) for start, length in parts]


def fresh_counters() -> np.ndarray:
    """Makes the counters that a call begins with."""
    counters = np.zeros(call_kernels.COUNTS, np.int64)
    counters[call_kernels.FULL_FROM] = call_kernels.NOT_FULL
    return counters
