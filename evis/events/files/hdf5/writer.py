"""Writes HDF5 as Prophesee's tools do: CD/events with ECF, CD/indexes, EXT_TRIGGER/events."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.files.file_writer import FileWriter, check_size
from evis.events.files.hdf5 import ecf
from evis.events.files.hdf5.ecf_layout import FILTER, MAX_SIDE
from evis.events.recording import RecordingError, Writer

_CHUNK = 1 << 14
_EVENT = np.dtype(
    {"names": ["x", "y", "p", "t"], "formats": ["<u2", "<u2", "<i2", "<i8"], "offsets": [0, 2, 4, 8], "itemsize": 16}
)
_EDGE = np.dtype({"names": ["p", "t", "id"], "formats": ["<i2", "<i8", "<i2"], "offsets": [0, 8, 16], "itemsize": 24})
_INDEX = np.dtype([("id", "<u8"), ("ts", "<i8")])
_INDEX_US = 2000


class Hdf5Writer(FileWriter):
    """Writes .hdf5. Times are rounded down to whole us.

    encoding `ecf`: a chunk that ECF cannot hold exactly (times that step back, coordinates beyond 2047) is stored as it
    is, with the filter marked as skipped, which every reader of such files knows. `plain`: no filter at all.
    """

    keeps = frozenset({"triggers"})

    def __init__(self, path: str | os.PathLike[str], width: int, height: int, plain: bool) -> None:
        super().__init__(path)
        import h5py

        self._file: Any = h5py.File(self.partial, "w", libver=("earliest", "v110"), track_order=False)
        self._file.attrs["version"], self._file.attrs["geometry"] = "1.0", f"{width}x{height}"
        creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        creation.set_chunk((_CHUNK,))
        creation.set_obj_track_times(False)
        if not plain:
            creation.set_filter(FILTER, h5py.h5z.FLAG_OPTIONAL)
        space = h5py.h5s.create_simple((0,), (h5py.h5s.UNLIMITED,))
        group = self._file.create_group("CD")
        kind = h5py.h5t.py_create(_EVENT, logical=True)
        self._events = h5py.Dataset(h5py.h5d.create(group.id, b"events", kind, space, creation))
        self._plain, self._n, self._waiting = plain, 0, Events.empty()
        self._index: list[tuple[int, int]] = []
        self._edges: list[Triggers] = []

    def write(self, events: Events) -> None:
        if len(events.triggers):
            self._edges.append(events.triggers)
        self._waiting = Events.concatenate([self._waiting, events[:]])
        while len(self._waiting) >= _CHUNK:
            self._chunk(self._waiting[:_CHUNK])
            self._waiting = self._waiting[_CHUNK:]

    def _chunk(self, events: Events) -> None:
        n, t = len(events), events.t // 1000
        self._events.resize((self._n + n,))
        rows = np.zeros(_CHUNK, _EVENT)
        rows["t"][:n], rows["x"][:n], rows["y"][:n], rows["p"][:n] = t, events.x, events.y, events.p
        whole = int(max(events.x.max(), events.y.max())) < MAX_SIDE and (np.diff(t) >= 0).all()
        if self._plain:
            self._events[self._n :] = rows[:n]
        elif whole:
            self._events.id.write_direct_chunk((self._n,), ecf.encode(t, events.x, events.y, events.p), 0)
        else:
            self._events.id.write_direct_chunk((self._n,), rows.tobytes(), 1)
        self._add_index(t)
        self._n += n

    def _add_index(self, t: np.ndarray) -> None:
        """Adds the first event of each 2 ms to the index."""
        first = int(t[0]) // _INDEX_US if not self._index else self._index[-1][1] // _INDEX_US + 1
        last = int(t.max()) // _INDEX_US
        reached = np.maximum.accumulate(t)
        # a pause has one entry for its end, not one for each 2 ms of it
        slots = np.unique(reached[reached >= first * _INDEX_US] // _INDEX_US)
        for slot in slots[slots <= last].tolist():
            self._index.append((self._n + int(np.searchsorted(reached, slot * _INDEX_US)), slot * _INDEX_US))

    def _finish(self) -> None:
        if len(self._waiting):
            self._chunk(self._waiting)
        self._file["CD"].create_dataset("indexes", data=np.array(self._index, _INDEX))
        edges = (
            Triggers(*(np.concatenate([getattr(e, n) for e in self._edges]) for n in ("t", "id", "value")))
            if self._edges
            else Triggers()
        )
        rows = np.zeros(len(edges), _EDGE)
        rows["t"], rows["id"], rows["p"] = edges.t // 1000, edges.id, edges.value
        self._file.create_group("EXT_TRIGGER").create_dataset("events", data=rows)
        self._file.close()


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> Writer:
    """Returns an HDF5 writer. encoding: ecf (default), plain or dsec. Raises RecordingError."""
    encoding = encoding or "ecf"
    if encoding not in ("ecf", "plain", "dsec"):
        raise RecordingError(f"{path}: cannot write the encoding '{encoding}'; known are ecf, plain and dsec")
    check_size(path, "HDF5", width, height, 65535)
    if encoding == "dsec":
        from evis.events.files.hdf5.dsec_writer import DsecEventsWriter

        return DsecEventsWriter(path, width, height)
    return Hdf5Writer(path, width, height, encoding == "plain")
