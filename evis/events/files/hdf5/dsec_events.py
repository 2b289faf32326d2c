"""Writes the file of events of one of DSEC's cameras, as uzh-rpg/DSEC reads it in scripts/utils/eventslicer.py."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.events.arrays import Events
from evis.events.files.hdf5.millisecond_index import NAME, MillisecondIndex
from evis.files.hdf5_rows import GrowingRows, blosc
from evis.files.hdf5_writing import NewFile

_TYPES: Mapping[str, Any] = {"t": np.uint32, "x": np.uint16, "y": np.uint16, "p": np.uint8}
_US_END = 1 << 32
"""DSEC's times are uint32 us: 71 minutes."""


class TooLongError(ValueError):
    """Says that DSEC's times have ended."""


class EventFile:
    """Writes one events.h5, in a folder that is there: events/t, x, y, p, ms_to_idx and t_offset.

    start_us: from when on its times count, which is t_offset; None = from the first event, in whole us.
    """

    def __init__(self, path: str | os.PathLike[str], start_us: int | None = None) -> None:
        self._file = NewFile(path, libver=("earliest", "v110"))
        packed = blosc() or {"compression": "gzip"}
        self._columns = {n: GrowingRows(self._file, f"events/{n}", (), d, **packed) for n, d in _TYPES.items()}
        self._marks = GrowingRows(self._file, NAME, (), np.uint64, **packed)
        self._start_us = start_us
        self._index = None if start_us is None else self._begin(start_us)

    def _begin(self, start_us: int) -> MillisecondIndex:
        self._start_us, self._file["t_offset"] = start_us, np.int64(start_us)
        return MillisecondIndex(start_us * 1000)

    def add(self, events: Events) -> None:
        """Writes events in order of time, rounded down to us. Raises TooLongError beyond DSEC's 71 minutes."""
        if self._index is None or self._start_us is None:
            if not len(events):
                return
            self._index = self._begin(int(events.t[0]) // 1000)
        t = events.t // 1000 - self._start_us
        if len(t) and int(t[-1]) >= _US_END:
            raise TooLongError("DSEC's times end after 71 minutes")
        for name, values in (("t", t.astype(np.uint32)), ("x", events.x), ("y", events.y), ("p", events.p)):
            self._columns[name].add(values)
        self._marks.add(self._index.add(events.t))
        self._file.check()

    def note_size(self, width: int, height: int) -> None:
        """Writes the sensor's size [px] as an attribute, as Prophesee's files have it and DSEC's do not."""
        self._file.attrs["geometry"] = f"{width}x{height}"

    def finish(self, end_ns: int) -> None:
        """Writes the index to its end, and closes the file."""
        self._marks.add((self._index or self._begin(0)).finish(end_ns))
        for rows in (*self._columns.values(), self._marks):
            rows.flush()
        self.close()

    def close(self) -> None:
        """Closes the file as it is."""
        self._file.close()
