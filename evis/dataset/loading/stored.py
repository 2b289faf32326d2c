"""Reads a sequence in files as a source of windows, and makes the table of its windows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from evis.dataset.errors import DatasetError
from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.sample import EVENTS, TABLES
from evis.dataset.loading.cut import Cut
from evis.dataset.loading.sample import Source, Window, label_stamps
from evis.dataset.loading.sequence import Sequence
from msgs.camera import CameraInfo

_BLOCK = 1 << 20
"""Events whose times are read at once."""


class Stored:
    """Reads one camera of a sequence for windows."""

    def __init__(self, sequence: Sequence, camera: str | None) -> None:
        self.sequence = sequence
        self.index, self.name, self.arguments = sequence.index, sequence.name, sequence.arguments
        self._asked = camera

    @cached_property
    def camera(self) -> str:
        """Returns the camera's name."""
        return self.sequence.camera(self._asked)

    @property
    def info(self) -> CameraInfo:
        """Returns the camera."""
        return self.sequence.cameras[self.camera]

    def events(self, t0_ns: int, t1_ns: int) -> dict[str, Any]:
        """Implements `Source.events`."""
        return self.sequence.events(t0_ns, t1_ns, self.camera)._asdict()

    def rows(self, first: int, end: int) -> dict[str, Any]:
        """Implements `Source.rows`."""
        with self.sequence.readable():
            return self.sequence.reader.rows(first, end, self.camera)._asdict()

    def event_labels(self, t0_ns: int, t1_ns: int) -> dict[str, Any]:
        """Implements `Source.event_labels`."""
        found = self.sequence.labels("events", t0_ns, t1_ns, self.camera)
        return {name: found[name] for name in EVENTS}

    def check_event_labels(self, cut: Cut) -> None:
        """Raises DatasetError where labels of events are asked for and not there: they have no stamps to be missed."""
        if "events" in cut.labels and "events" not in self.sequence.kinds(self.camera):
            self.stamps("events")

    def stamps(self, kind: str) -> np.ndarray:
        """Implements `Source.stamps`. Raises DatasetError for labels that are not there."""
        with self.sequence.readable():
            try:
                return self.sequence.reader.stamps(kind, self.camera)
            except LayoutError as error:
                raise DatasetError(f"{error}; the recipe's `labels:` names what a data set is to have") from None

    def label(self, kind: str, stamp_ns: int) -> dict[str, Any]:
        """Implements `Source.label`."""
        found = self.sequence.labels(kind, stamp_ns, stamp_ns + 1, self.camera)
        rows = kind in TABLES
        if not rows and len(found["t"]) != 1:
            raise DatasetError(f"{self.name} has {len(found['t'])} labels '{kind}' at {stamp_ns} ns, not one")
        return {name: array if rows else array[0] for name, array in found.items() if name not in ("t", "offsets")}


@dataclass(frozen=True)
class Table:
    """Holds all windows of a sequence that have what is asked for.

    number, t0, t1: int64 [n]. rows: int64 [n, 2] or None. stamps, back: see Window. without: number of windows that
    were left out, as they have no label.
    """

    number: np.ndarray
    t0: np.ndarray
    t1: np.ndarray
    rows: np.ndarray | None
    stamps: dict[str, np.ndarray]
    back: dict[str, np.ndarray]
    without: int

    def __len__(self) -> int:
        return len(self.number)

    def window(self, i: int) -> Window:
        """Returns the i-th window."""
        return Window(
            int(self.number[i]),
            int(self.t0[i]),
            int(self.t1[i]),
            None if self.rows is None else (int(self.rows[i, 0]), int(self.rows[i, 1])),
            {kind: int(stamps[i]) for kind, stamps in self.stamps.items()},
            {kind: int(stamps[i]) for kind, stamps in self.back.items()},
        )


def table_of(stored: Stored, cut: Cut) -> Table:
    """Lists the windows of a sequence: by time without reading an event; by number, and labelled, their times alone."""
    sequence, camera, rows = stored.sequence, stored.camera, None
    stored.check_event_labels(cut)
    if cut.seconds:
        number = np.arange(cut.count_by_time(sequence.duration_ns))
        t0, t1 = cut.by_time(number, sequence.start_ns)
    else:
        number = np.arange(max((sequence.count(camera) - cut.events) // int(cut.stride) + 1, 0))
        rows = np.stack([number * int(cut.stride), number * int(cut.stride) + cut.events], -1)
        t0, t1 = _times(stored, rows)
    return labelled(stored, cut, number, t0, t1, rows)


def labelled(source: Source, cut: Cut, number: Any, t0: Any, t1: Any, rows: Any) -> Table:
    """Returns the table of the windows that have all labels that are asked for."""
    stamps, back = label_stamps(source, cut, t0, t1)
    has = np.ones(len(number), bool)
    for found in (*stamps.values(), *back.values()):
        has &= found >= 0
    pick = lambda columns: {kind: column[has] for kind, column in columns.items()}
    kept = None if rows is None else rows[has]
    return Table(number[has], t0[has], t1[has], kept, pick(stamps), pick(back), int(np.count_nonzero(~has)))


def _times(stored: Stored, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """When windows by number begin, and just after their last events [ns]; their sequence is read once."""
    wanted = np.unique(np.concatenate([rows[:, 0], rows[:, 1] - 1]))
    times = np.empty(len(wanted), np.int64)
    for first in range(0, int(wanted[-1]) + 1 if len(wanted) else 0, _BLOCK):
        a, b = np.searchsorted(wanted, [first, first + _BLOCK])
        if b > a:
            times[a:b] = stored.rows(first, int(wanted[b - 1]) + 1)["t"][wanted[a:b] - first]
    return times[np.searchsorted(wanted, rows[:, 0])], times[np.searchsorted(wanted, rows[:, 1] - 1)] + 1
