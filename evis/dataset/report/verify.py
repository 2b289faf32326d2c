"""Verifies that a data set is whole: the checksum of every file, and every sequence read by its layout's reader."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from evis.dataset.layouts import reader_of
from evis.dataset.layouts.reader import edges_of
from evis.dataset.making.finished import ENTRY, sha256_of
from evis.dataset.report.summary import opened
from evis.files.damage import error_text

BLOCK_NS = 100_000_000
"""Events are read so much at a time, so that memory does not grow with length."""


def verify(out: str, tick: Callable[[int, int], None] = lambda done, of: None) -> dict[str, Any]:
    """Checks all sequences of a data set, and tells what is wrong in one line each. Raises DatasetError, OSError.

    tick: is told how many sequences are done, of how many.
    """
    store, index = opened(out)
    wrong, files, events = [], 0, 0
    for done, entry in enumerate(index["sequences"]):
        tick(done, len(index["sequences"]))
        with store.local(entry["path"]) as folder:
            found, read = _sequence(folder, entry, index["layout"])
        wrong += [f"{entry['path']}{text}" for text in found]
        files += len(entry["files"])
        events += read
    there = {entry["index"] for entry in store.entries()}
    listed = {entry["index"] for entry in index["sequences"]}
    if unlisted := len(there - listed):
        wrong.append(f"{unlisted} finished sequences are not in dataset.json; `make ... --resume` lists them")
    return {"sequences": len(listed), "files": files, "events": events, "failed": index["failed"], "wrong": wrong}


def _sequence(folder: Path, entry: dict[str, Any], layout: str) -> tuple[list[str], int]:
    """What is wrong with one sequence, and the number of events that were read."""
    wrong = []
    for name, expected in entry["files"].items():
        path = folder / name
        if not path.is_file():
            wrong.append(f"/{name} is missing")
        elif sha256_of(path) != expected:
            wrong.append(f"/{name} is not as it was written: its checksum is another")
    if folder.is_dir():
        there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
        wrong += [f"/{name} was not written by evis" for name in sorted(there - {*entry["files"], ENTRY})]
    if wrong:
        return wrong, 0
    try:
        reader = reader_of(layout)(folder)
        events = sum(_count(reader, camera) for camera in reader.cameras)
    except (ValueError, OSError, KeyError) as error:
        return [f" cannot be read as {layout}: {error_text(error)}"], 0
    if events != entry["events"]:
        wrong.append(f" has {events} events; {entry['events']} were simulated")
    return wrong, events


def _count(reader: Any, camera: str) -> int:
    """Reads all events of a camera."""
    edges = edges_of(reader.about, BLOCK_NS)
    return sum(len(reader.events(t0, t1, camera).t) for t0, t1 in itertools.pairwise(edges))
