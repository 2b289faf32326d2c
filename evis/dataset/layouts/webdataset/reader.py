"""Reads a sequence of WebDataset shards."""

from __future__ import annotations

import io
import tarfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.columns import EVENT_TYPES
from evis.dataset.layouts.joined import joined, no_rows, of_events
from evis.dataset.layouts.npz.archive import unpacked
from evis.dataset.layouts.reader import ANEW, EventArrays, SequenceReader, framed, within
from evis.dataset.layouts.sample import EVENTS
from evis.files.json_text import parsed
from evis.files.regular import check_file
from evis.media.frames.images import codes


@dataclass
class _Entry:
    """Where the parts of a sample are: name -> (shard, offset, bytes)."""

    told: dict[str, Any] = field(default_factory=dict)
    parts: dict[str, tuple[Path, int, int]] = field(default_factory=dict)


class WebdatasetReader(SequenceReader):
    """Goes over the headers of the shards once, and then reads the samples that are asked for."""

    LAYOUT = "webdataset"

    @cached_property
    def _entries(self) -> dict[str, list[_Entry]]:
        found: dict[str, _Entry] = {}
        for shard in sorted(self.directory.glob("*.tar")):
            _check_end(shard)
            try:
                with tarfile.open(shard) as tar:
                    for member in tar:
                        key, _, part = member.name.partition(".")
                        entry = found.setdefault(key, _Entry())
                        entry.parts[part] = shard, member.offset_data, member.size
            except tarfile.TarError as error:
                raise LayoutError(f"{shard} cannot be read ({error}); {ANEW}") from None
        cameras: dict[str, list[_Entry]] = {camera: [] for camera in self.cameras}
        for key, entry in found.items():
            if "json" not in entry.parts:
                raise LayoutError(f"{self.directory} has no {key}.json in its shards; {ANEW}")
            try:
                entry.told = _said(_bytes(entry.parts["json"]))
                cameras[entry.told["camera"]].append(entry)
            except (KeyError, TypeError, ValueError) as error:
                raise LayoutError(f"{self.directory}: {key}.json cannot be read ({error!s:.80}); {ANEW}") from None
        for camera, count in self.about.counts.items():
            there = sum(entry.told["events"] for entry in cameras[camera])
            if there != count:
                raise LayoutError(f"{self.directory} has {there} events of {camera}, {count} were written; {ANEW}")
        return cameras

    def _count_of(self, camera: str) -> int:
        return sum(entry.told["events"] for entry in self._entries[camera])

    def _kinds(self, camera: str) -> tuple[str, ...]:
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
            return {"t": told["stamp_ns"], "image": framed(stacked), "exposure_ns": told["exposure_ns"]}
        there = [e for e in self._entries[camera] if t0 <= e.told["stamp_ns"] < t1 and f"{kind}.npz" in e.parts]
        return joined(kind, [(entry.told["stamp_ns"], _arrays(entry, kind)) for entry in there], info)


def _said(text: bytes) -> dict[str, Any]:
    """What a sample says of itself. Raises ValueError, KeyError, TypeError for what no writer says."""
    told: dict[str, Any] = parsed(text)
    for name in ("events", "stamp_ns", *(("first_ns", "last_ns") if told["events"] else ())):
        if type(told[name]) is not int:
            raise ValueError(f"its {name} is {told[name]!r:.40}")
    return told | {"event_labels": bool(told["event_labels"])}


def _check_end(shard: Path) -> None:
    """Raises LayoutError for a shard that ends between two samples, which tarfile takes for its end."""
    check_file(shard)
    with shard.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        file.seek(max(size - 2 * tarfile.BLOCKSIZE, 0))
        if size < 2 * tarfile.BLOCKSIZE or any(file.read()):
            raise LayoutError(f"{shard} ends early; {ANEW}")


def _bytes(place: tuple[Path, int, int]) -> bytes:
    path, offset, size = place
    with path.open("rb") as file:
        file.seek(offset)
        return file.read(size)


def _arrays(entry: _Entry, part: str) -> dict[str, np.ndarray]:
    place = entry.parts[f"{part}.npz"]
    return unpacked(_bytes(place), f"{place[0]}: {part}.npz")
