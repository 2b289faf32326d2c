"""Reads a sequence in MVSEC's layout."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from evis.dataset.layouts.dsec import sides
from evis.dataset.layouts.npz import mapped
from evis.dataset.layouts.reader import EventArrays, SequenceReader, within

_PLACES = {"depth": ("gt", "depth_image_raw"), "poses": ("gt", "pose"), "image": ("data", "image_raw")}


class MvsecReader(SequenceReader):
    """Reads events, depth (inf where MVSEC has NaN), the camera's poses as matrices [T, 4, 4], frames and flow.

    Without an index in the files, the first event of a time is found by bisection.
    """

    def __init__(self, directory: Path) -> None:
        super().__init__(directory)
        self._sides = sides(dict(self.cameras), self.about.name)

    def _file(self, part: str) -> h5py.File:
        return h5py.File(self.directory / f"{self.about.name}_{part}.hdf5", "r")

    @property
    def _flow(self) -> Path:
        return self.directory / f"{self.about.name}_gt_flow_dist.npz"

    def kinds(self, camera: str) -> tuple[str, ...]:
        found = []
        for kind, (part, name) in _PLACES.items():
            with self._file(part) as file:
                found += [kind] if f"davis/{self._sides[camera]}/{name}" in file else []
        return (*found, *(["forward_flow"] if self._sides[camera] == "left" and self._flow.exists() else []))

    def count_of(self, camera: str) -> int:
        with self._file("data") as file:
            return int(file[f"davis/{self._sides[camera]}/events"].shape[0])

    def _events(self, t0: int, t1: int, camera: str) -> EventArrays:
        with self._file("data") as file:
            table = file[f"davis/{self._sides[camera]}/events"]
            first, end = (_first(table, limit) for limit in (t0, t1))
            return _arrays(table[first : max(first, end)])

    def _rows(self, first: int, end: int, camera: str) -> EventArrays:
        with self._file("data") as file:
            return _arrays(file[f"davis/{self._sides[camera]}/events"][first:end])

    def _labels(self, kind: str, t0: int, t1: int, camera: str) -> dict[str, np.ndarray]:
        if kind == "forward_flow":
            stamps = _ns(np.asarray(mapped(self._flow, "timestamps")))
            ends = stamps[1:]
            part = within(ends, t0, t1)
            x, y = (np.asarray(mapped(self._flow, f"{axis}_flow_dist")[part]) for axis in "xy")
            times = np.stack((stamps[:-1][part], ends[part]), -1)
            flow = np.stack((x, y), -1).astype(np.float32)
            return {"t": ends[part], "flow_t": times, kind: flow, "forward_valid": np.isfinite(x).astype(np.uint8)}
        source, name = _PLACES[kind]
        with self._file(source) as file:
            group = file[f"davis/{self._sides[camera]}"]
            stamps = _ns(group[f"{name}_ts"][:])
            part = within(stamps, t0, t1)
            array = group[name][part]
        if kind == "depth":
            array = np.where(np.isnan(array), np.float32(np.inf), array)
        return {"t": stamps[part], {"poses": "pose"}.get(kind, kind): array}


def _arrays(rows: np.ndarray) -> EventArrays:
    x, y, t, p = rows.T
    return EventArrays(_ns(t), x.astype(np.uint16), y.astype(np.uint16), (p > 0).astype(np.uint8))


def _first(table: h5py.Dataset, t_ns: int) -> int:
    """The first row at or after a time."""
    low, high = 0, int(table.shape[0])
    while low < high:
        middle = (low + high) // 2
        if round(float(table[middle, 2]) * 1e9) < t_ns:
            low = middle + 1
        else:
            high = middle
    return low


def _ns(seconds: np.ndarray) -> np.ndarray:
    return np.rint(np.asarray(seconds, np.float64) * 1e9).astype(np.int64)
