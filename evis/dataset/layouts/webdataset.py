"""WebDataset: tar shards whose samples are the steps of a camera, in order of time, for reading as a stream.

A sample `<camera>/<number>` has `.json` (stamp_ns, t0_ns, camera, number and times of the events), `.events.npz` with
t, x, y, p and the labels of events, `.<kind>.npz` for each kind of label, and `.image.png`.
"""

from __future__ import annotations

import io
import json
import tarfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag.export.png import encoded
from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.columns import EVENT_TYPES
from evis.dataset.layouts.joined import joined, no_rows, of_events
from evis.dataset.layouts.reader import EventArrays, SequenceReader, within
from evis.dataset.layouts.sample import EVENTS, Sample
from evis.dataset.layouts.writer import SequenceWriter
from evis.media.frames.png import codes

SHARD_BYTES = 256 << 20
"""A shard ends with the sample that makes it longer."""


class WebdatasetWriter(SequenceWriter):
    """Writes shard after shard, and each sample as it comes."""

    LAYOUT = "webdataset"

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._shards = 0
        self._tar: tarfile.TarFile | None = None
        self._numbers = dict.fromkeys(self.about.cameras, 0)

    def _add(self, camera: str, sample: Sample) -> None:
        key = f"{camera}/{self._numbers[camera]:08d}"
        self._numbers[camera] += 1
        events = sample.events
        arrays = {name: np.asarray(getattr(events, name), dtype) for name, dtype in EVENT_TYPES.items()}
        arrays |= {name: sample.labels[name] for name in EVENTS if name in sample.labels}
        kinds = dict(sample.kinds())
        told: dict[str, Any] = {"camera": camera, "stamp_ns": sample.stamp_ns, "t0_ns": sample.t0_ns}
        told |= {"events": len(events), "first_ns": int(events.t[0]) if len(events) else None}
        told |= {"last_ns": int(events.t[-1]) if len(events) else None, "event_labels": EVENTS[0] in arrays}
        if sample.image is not None:
            told["image"] = {"stamp_ns": sample.image.header.stamp_ns, "exposure_ns": sample.image.exposure_ns}
        self._member(f"{key}.json", json.dumps(told, sort_keys=True).encode())
        self._member(f"{key}.events.npz", _packed(arrays))
        for kind, labels in kinds.items():
            self._member(f"{key}.{kind}.npz", _packed(labels))
        if sample.image is not None:
            self._member(f"{key}.image.png", encoded(np.asarray(sample.image.data), sample.image.encoding))
        if self._tar is not None and self._tar.offset > SHARD_BYTES:
            self._tar.close()
            self._tar = None

    def _member(self, name: str, data: bytes) -> None:
        if self._tar is None:
            self._tar = tarfile.open(self.directory / f"{self._shards:06d}.tar", "w", format=tarfile.USTAR_FORMAT)
            self._shards += 1
        info = tarfile.TarInfo(name)
        info.size = len(data)
        self._tar.addfile(info, io.BytesIO(data))
        self._tar.members.clear()  # type: ignore[attr-defined] # of which it would keep a list as long as the sequence

    def _finish(self) -> None:
        if self._tar is not None:
            self._tar.close()


@dataclass
class _Entry:
    """Where the parts of a sample are: name -> (shard, offset, bytes)."""

    told: dict[str, Any] = field(default_factory=dict)
    parts: dict[str, tuple[Path, int, int]] = field(default_factory=dict)


class WebdatasetReader(SequenceReader):
    """Goes over the headers of the shards once, and then reads the samples that are asked for."""

    @cached_property
    def _entries(self) -> dict[str, list[_Entry]]:
        found: dict[str, _Entry] = {}
        for shard in sorted(self.directory.glob("*.tar")):
            try:
                with tarfile.open(shard) as tar:
                    for member in tar:
                        key, _, part = member.name.partition(".")
                        entry = found.setdefault(key, _Entry())
                        entry.parts[part] = shard, member.offset_data, member.size
            except tarfile.TarError as error:
                raise LayoutError(f"{shard} cannot be read ({error}); make the sequence anew") from None
        cameras: dict[str, list[_Entry]] = {camera: [] for camera in self.cameras}
        for entry in found.values():
            entry.told = json.loads(_bytes(entry.parts["json"]))
            cameras[entry.told["camera"]].append(entry)
        return cameras

    def count_of(self, camera: str) -> int:
        return sum(entry.told["events"] for entry in self._entries[camera])

    def kinds(self, camera: str) -> tuple[str, ...]:
        found: dict[str, None] = {}
        for entry in self._entries[camera]:
            found |= {part.partition(".")[0]: None for part in entry.parts if part not in ("json", "events.npz")}
            found |= {"events": None} if entry.told["event_labels"] else {}
        return tuple(found)

    def _with_events(self, t0: int, t1: int, camera: str) -> list[dict[str, np.ndarray]]:
        there = [e for e in self._entries[camera] if e.told["events"]]
        return [_arrays(e, "events") for e in there if e.told["last_ns"] >= t0 and e.told["first_ns"] < t1]

    def _events(self, t0: int, t1: int, camera: str) -> EventArrays:
        found = self._with_events(t0, t1, camera)
        columns = [np.concatenate([np.empty(0, d), *(part[n] for part in found)]) for n, d in EVENT_TYPES.items()]
        part = within(columns[0], t0, t1)
        return EventArrays(*(column[part] for column in columns))

    def _labels(self, kind: str, t0: int, t1: int, camera: str) -> dict[str, np.ndarray]:
        info = self.cameras[camera]
        if kind == "events":
            found = self._with_events(t0, t1, camera)
            t = np.concatenate([np.empty(0, np.int64), *(part["t"] for part in found)])
            rows = {n: np.concatenate([no_rows(n, info), *(part[n] for part in found)]) for n in EVENTS}
            return of_events(t, rows, within(t, t0, t1))
        if kind == "image":
            there = [e for e in self._entries[camera] if "image" in e.told and t0 <= e.told["image"]["stamp_ns"] < t1]
            told = {n: np.array([e.told["image"][n] for e in there], np.int64) for n in ("stamp_ns", "exposure_ns")}
            images = [codes(_bytes(e.parts["image.png"])) for e in there]
            stacked = np.stack(images) if images else np.empty((0, 0, 0), np.uint8)
            return {"t": told["stamp_ns"], "exposure_ns": told["exposure_ns"], "image": stacked}
        there = [e for e in self._entries[camera] if t0 <= e.told["stamp_ns"] < t1 and f"{kind}.npz" in e.parts]
        return joined(kind, [(entry.told["stamp_ns"], _arrays(entry, kind)) for entry in there], info)


def _packed(arrays: dict[str, np.ndarray]) -> bytes:
    data = io.BytesIO()
    np.savez_compressed(data, **arrays)  # type: ignore[arg-type]
    return data.getvalue()


def _bytes(place: tuple[Path, int, int]) -> bytes:
    path, offset, size = place
    with path.open("rb") as file:
        file.seek(offset)
        return file.read(size)


def _arrays(entry: _Entry, part: str) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(_bytes(entry.parts[f"{part}.npz"])), allow_pickle=False) as archive:
        return dict(archive)
