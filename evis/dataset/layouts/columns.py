"""Writes a sequence as columns that grow: what npz and Zarr have in common, and the events of COCO.

Of each camera there are `events/t`, `x`, `y`, `p` and `events/ms_to_idx`; a group for each kind of label with its
stamps `t` and its arrays; of tables also `offsets`; the labels of events beside `events/t`; and `image/image`, `t` and
`exposure_ns`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.reader import EventArrays, SequenceReader, spans, within
from evis.dataset.layouts.sample import DENSE, EVENTS, TABLES, Sample
from evis.dataset.layouts.writer import SequenceWriter
from evis.events.files.hdf5.millisecond_index import NAME, MillisecondIndex
from msgs.camera import INTERVAL_FLOWS

EVENT_TYPES: Mapping[str, Any] = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8}


class ColumnsWriter(SequenceWriter):
    """Takes samples apart into rows of columns; a layout says where rows of a column go."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._indices = {camera: MillisecondIndex(self.about.start_ns) for camera in self.about.cameras}
        self._rows: dict[tuple[str, str], int] = {}

    @abstractmethod
    def _append(self, camera: str, column: str, rows: np.ndarray) -> None:
        """Puts rows [n, ...] at the end of a column, which is made when its first rows come."""

    def _add(self, camera: str, sample: Sample) -> None:
        events = sample.events
        for name, dtype in EVENT_TYPES.items():
            self._append(camera, f"events/{name}", np.asarray(getattr(events, name), dtype))
        self._append(camera, f"events/{NAME}", self._indices[camera].add(events.t))
        for name in EVENTS:
            if name in sample.labels:
                self._append(camera, f"events/{name}", sample.labels[name])
        for kind, arrays in sample.kinds():
            self._append(camera, f"{kind}/t", np.array([sample.stamp_ns], np.int64))
            if kind in TABLES:
                self._append_table(camera, kind, arrays)
                continue
            for name, array in arrays.items():
                self._append(camera, f"{kind}/{name}", array[None])
        if sample.image is not None:
            self._append(camera, "image/t", np.array([sample.image.header.stamp_ns], np.int64))
            self._append(camera, "image/exposure_ns", np.array([sample.image.exposure_ns], np.int64))
            self._append(camera, "image/image", np.asarray(sample.image.data)[None])

    def _append_table(self, camera: str, kind: str, arrays: dict[str, np.ndarray]) -> None:
        if (camera, kind) not in self._rows:
            self._rows[camera, kind] = 0
            self._append(camera, f"{kind}/offsets", np.zeros(1, np.int64))
        for name, array in arrays.items():
            self._append(camera, f"{kind}/{name}", array)
        self._rows[camera, kind] += len(array)
        self._append(camera, f"{kind}/offsets", np.array([self._rows[camera, kind]], np.int64))

    def _finish(self) -> None:
        end = self.about.start_ns + self.about.duration_ns
        for camera, index in self._indices.items():
            self._append(camera, f"events/{NAME}", index.finish(end))


class ColumnsReader(SequenceReader):
    """Reads slices of columns; a layout says where a column is."""

    @abstractmethod
    def _column(self, camera: str, column: str) -> Any:
        """Returns a column, of which slices may be read."""

    @abstractmethod
    def _columns(self, camera: str) -> tuple[str, ...]:
        """Lists the columns of a camera."""

    def _kinds(self, camera: str) -> tuple[str, ...]:
        columns = self._columns(camera)
        found = [kind for kind in (*DENSE, *TABLES, "image") if f"{kind}/t" in columns]
        return (*found, *(["events"] if f"events/{EVENTS[0]}" in columns else []))

    def _count_of(self, camera: str) -> int:
        return int(self._column(camera, "events/t").shape[0])

    def _events(self, t0: int, t1: int, camera: str) -> EventArrays:
        part = self._part(t0, t1, camera)
        return EventArrays(*(np.asarray(self._column(camera, f"events/{name}")[part]) for name in EVENT_TYPES))

    def _rows(self, first: int, end: int, camera: str) -> EventArrays:
        return EventArrays(*(np.asarray(self._column(camera, f"events/{name}")[first:end]) for name in EVENT_TYPES))

    def _intervals(self, kind: str, camera: str) -> np.ndarray:
        flow = kind in INTERVAL_FLOWS
        flow_t = np.asarray(self._column(camera, f"{kind}/flow_t")[:]) if flow else None
        return spans(np.asarray(self._column(camera, f"{kind}/t")[:]), flow_t)

    def _part(self, t0: int, t1: int, camera: str) -> slice:
        """Which events lie in [t0, t1): by the index to the millisecond, and then by their times."""
        t = self._column(camera, "events/t")
        index = self._column(camera, f"events/{NAME}")
        marks, count = index.shape[0], t.shape[0]
        bounds = []
        for limit in (t0, t1):
            ms = (limit - self.about.start_ns) // 1_000_000
            first = 0 if ms < 0 else int(index[ms]) if ms < marks else count
            end = 0 if ms + 1 < 0 else int(index[ms + 1]) if ms + 1 < marks else count
            bounds.append(first + int(np.searchsorted(np.asarray(t[first:end]), limit)))
        return slice(bounds[0], max(bounds))

    def _labels(self, kind: str, t0: int, t1: int, camera: str) -> dict[str, np.ndarray]:
        if kind == "events":
            part = self._part(t0, t1, camera)
            return {n: np.asarray(self._column(camera, f"events/{n}")[part]) for n in ("t", *EVENTS)}
        stamps = np.asarray(self._column(camera, f"{kind}/t")[:])
        part = within(stamps, t0, t1)
        found = {"t": stamps[part]}
        if kind in TABLES:
            offsets = np.asarray(self._column(camera, f"{kind}/offsets")[part.start : part.stop + 1])
            rows = slice(int(offsets[0]), int(offsets[-1]))
            arrays = {n: np.asarray(self._column(camera, f"{kind}/{n}")[rows]) for n in TABLES[kind]}
            return found | {"offsets": offsets - offsets[0]} | arrays
        names = DENSE.get(kind, ("image", "exposure_ns"))
        return found | {n: np.asarray(self._column(camera, f"{kind}/{n}")[part]) for n in names}


def check_shape(camera: str, column: str, rows: np.ndarray, shape: tuple[int, ...], dtype: Any) -> None:
    """Raises LayoutError unless rows are like those that a column begins with."""
    if rows.shape[1:] != shape or rows.dtype != dtype:
        was, now = (f"{list(s)} {np.dtype(d)}" for s, d in ((shape, dtype), (rows.shape[1:], rows.dtype)))
        raise LayoutError(f"{column} of {camera} changes from {was} to {now}; write what follows as another sequence")
