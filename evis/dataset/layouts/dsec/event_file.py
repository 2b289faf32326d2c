"""Writes the file of events of one of DSEC's cameras, as uzh-rpg/DSEC reads it in scripts/utils/eventslicer.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.columns import EVENT_TYPES
from evis.dataset.layouts.hdf5_rows import GrowingRows, blosc
from evis.dataset.layouts.millisecond_index import NAME, MillisecondIndex
from evis.events.arrays import Events
from evis.files.hdf5_writing import NewFile

_US_END = 1 << 32
"""DSEC's times are uint32 us: 71 minutes."""


class EventFile:
    """Writes one events.h5."""

    def __init__(self, path: Path, start_us: int) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = NewFile(path, libver=("earliest", "v110"))
        self._start_us = start_us
        self._index = MillisecondIndex(start_us * 1000)
        packed = blosc() or {"compression": "gzip"}
        types = {**EVENT_TYPES, "t": np.uint32}
        self._columns = {n: GrowingRows(self._file, f"events/{n}", (), d, **packed) for n, d in types.items()}
        self._marks = GrowingRows(self._file, NAME, (), np.uint64, **packed)
        self._file["t_offset"] = np.int64(start_us)

    def add(self, events: Events) -> None:
        """Writes events, their times rounded down to us. Raises LayoutError beyond DSEC's 71 minutes."""
        t = events.t // 1000 - self._start_us
        if len(t) and int(t[-1]) >= _US_END:
            raise LayoutError("DSEC's times end after 71 minutes; make shorter sequences, or take the layout npz")
        for name, values in (("t", t.astype(np.uint32)), ("x", events.x), ("y", events.y), ("p", events.p)):
            self._columns[name].add(values)
        self._marks.add(self._index.add(events.t))
        self._file.check()

    def close(self, end_ns: int) -> None:
        """Writes the index to its end."""
        self._marks.add(self._index.finish(end_ns))
        for rows in (*self._columns.values(), self._marks):
            rows.flush()
        self._file.close()
