"""Reads a sequence in MVSEC's layout."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from evis.dataset.layouts.hdf5_reading import dataset, has, opened
from evis.dataset.layouts.mvsec.event_table import first_row, nanoseconds
from evis.dataset.layouts.npz.archive import mapped
from evis.dataset.layouts.reader import EventArrays, SequenceReader, framed, within
from evis.dataset.layouts.stereo_sides import sides

_PLACES = {"depth": ("gt", "depth_image_raw"), "poses": ("gt", "pose"), "image": ("data", "image_raw")}


class MvsecReader(SequenceReader):
    """Reads events, depth (inf where MVSEC has NaN), the camera's poses as matrices [T, 4, 4], frames and flow.

    Without an index in the files, the first event of a time is found by bisection. Flow of 0 is not valid.
    """

    LAYOUT = "mvsec"

    def __init__(self, directory: Path) -> None:
        super().__init__(directory)
        self._sides = sides(dict(self.cameras), self.about.name)

    def _file(self, part: str) -> h5py.File:
        return opened(self.directory / f"{self.about.name}_{part}.hdf5")

    @property
    def _flow(self) -> Path:
        return self.directory / f"{self.about.name}_gt_flow_dist.npz"

    def _kinds(self, camera: str) -> tuple[str, ...]:
        found = []
        for kind, (part, name) in _PLACES.items():
            found += [kind] if has(self._file(part), f"davis/{self._sides[camera]}/{name}") else []
        return (*found, *(["forward_flow"] if self._sides[camera] == "left" and self._flow.exists() else []))

    def _count_of(self, camera: str) -> int:
        file = self._file("data")
        return int(dataset(file, f"davis/{self._sides[camera]}/events").shape[0])

    def _events(self, t0: int, t1: int, camera: str) -> EventArrays:
        file = self._file("data")
        table = dataset(file, f"davis/{self._sides[camera]}/events")
        first, end = (first_row(table, limit) for limit in (t0, t1))
        return _arrays(table[first : max(first, end)])

    def _rows(self, first: int, end: int, camera: str) -> EventArrays:
        file = self._file("data")
        return _arrays(dataset(file, f"davis/{self._sides[camera]}/events")[first:end])

    def _labels(self, kind: str, t0: int, t1: int, camera: str) -> dict[str, np.ndarray]:
        if kind == "forward_flow":
            stamps = nanoseconds(np.asarray(mapped(self._flow, "timestamps")))
            ends = stamps[1:]
            part = within(ends, t0, t1)
            x, y = (np.asarray(mapped(self._flow, f"{axis}_flow_dist")[part]) for axis in "xy")
            times = np.stack((stamps[:-1][part], ends[part]), -1)
            flow: np.ndarray = np.stack((x, y), -1).astype(np.float32)
            return {"t": ends[part], "flow_t": times, kind: flow, "forward_valid": (flow != 0).any(-1).astype(np.uint8)}
        source, name = _PLACES[kind]
        file = self._file(source)
        place = f"davis/{self._sides[camera]}/{name}"
        stamps = nanoseconds(dataset(file, f"{place}_ts")[:])
        part = within(stamps, t0, t1)
        array = dataset(file, place)[part]
        if kind == "depth":
            array = np.where(np.isnan(array), np.float32(np.inf), array)
        array = framed(array) if kind == "image" else array
        return {"t": stamps[part], {"poses": "pose"}.get(kind, kind): array}


def _arrays(rows: np.ndarray) -> EventArrays:
    x, y, t, p = rows.T
    return EventArrays(nanoseconds(t), x.astype(np.uint16), y.astype(np.uint16), (p > 0).astype(np.uint8))
