"""Reads event files with other libraries, each in its own words: a script for the Python that has them.

`python peers.py REPEATS PATH:FORMAT:WIDTH:HEIGHT ...` prints JSON: per file and library the events, the SHA-256
of t [us] | x | y | p (int64, 3 x uint16/uint16/uint8, little endian), how many times run back, and CPU seconds.
Imports nothing of this project, so that it runs in any environment.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import importlib.metadata
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

Arrays = tuple[Any, Any, Any, Any]


def read_evt3(path: str, form: str, width: int, height: int) -> Arrays:
    """Reads with evt3 (Rust)."""
    events = importlib.import_module("evt3").decode_file(path)
    return events.t if hasattr(events, "t") else events.timestamp, events.x, events.y, events.p


def read_expelliarmus(path: str, form: str, width: int, height: int) -> Arrays:
    """Reads with expelliarmus (C)."""
    events = importlib.import_module("expelliarmus").Wizard(encoding=form, fpath=path).read()
    if events is None:
        raise ValueError("gives up at trigger words")
    return events["t"], events["x"], events["y"], events["p"]


def read_faery(path: str, form: str, width: int, height: int) -> Arrays:
    """Reads with faery (Rust)."""
    stream = importlib.import_module("faery").events_stream_from_file(path, dimensions_fallback=(width, height))
    events = stream.to_array()
    return events["t"], events["x"], events["y"], events["on"]


def read_aedat(path: str, form: str, width: int, height: int) -> Arrays:
    """Reads with aedat (Rust)."""
    packets = [p["events"] for p in importlib.import_module("aedat").Decoder(path) if "events" in p]
    events = np.concatenate(packets)
    return events["t"], events["x"], events["y"], events["on"]


def read_dv_processing(path: str, form: str, width: int, height: int) -> Arrays:
    """Reads with dv-processing (C++)."""
    recording = importlib.import_module("dv_processing").io.MonoCameraRecording(path)
    packets = []
    while recording.isRunning() and (batch := recording.getNextEventBatch()) is not None:
        packets.append(batch.numpy())
    events = np.concatenate(packets)
    return events["timestamp"], events["x"], events["y"], events["polarity"]


PEERS: dict[str, tuple[Callable[[str, str, int, int], Arrays], tuple[str, ...]]] = {
    "evt3": (read_evt3, ("evt3",)),
    "expelliarmus": (read_expelliarmus, ("evt3", "evt2")),
    "faery": (read_faery, ("evt3", "evt2", "aedat4")),
    "aedat": (read_aedat, ("aedat4",)),
    "dv_processing": (read_dv_processing, ("aedat4",)),
}
"""Import name -> reader, formats."""


def digest(t: Any, x: Any, y: Any, p: Any) -> dict[str, Any]:
    """Computes count, hash and backward steps of decoded arrays, t in us."""
    t = np.asarray(t).astype(np.int64)
    hashed = hashlib.sha256()
    for array, dtype in ((t, "<i8"), (x, "<u2"), (y, "<u2"), (p, "u1")):
        hashed.update(np.ascontiguousarray(np.asarray(array).astype(dtype)).tobytes())
    last = int(t[-1]) if len(t) else 0
    return {"events": len(t), "sha256": hashed.hexdigest(), "back": int((np.diff(t) < 0).sum()), "last_us": last}


def main(repeats: int, files: list[str]) -> dict[str, Any]:
    """Reads each file with each library; returns versions, absent libraries and what came of each file."""
    found: dict[str, str] = {}
    for name in PEERS:
        try:
            importlib.import_module(name)
            found[name] = importlib.metadata.version(name.replace("_", "-"))
        except ImportError:
            continue
    results: dict[str, Any] = {"absent": sorted(set(PEERS) - set(found)), "versions": found, "files": {}}
    for spec in files:
        path, form, width, height = spec.rsplit(":", 3)
        row = results["files"][path] = {}
        for name, (read, formats) in PEERS.items():
            if name not in found or form not in formats:
                continue
            try:
                times = []
                for _ in range(repeats):
                    start = time.process_time()
                    arrays = read(path, form, int(width), int(height))
                    times.append(time.process_time() - start)
                row[name] = {**digest(*arrays), "cpu_s": min(times)}
            except Exception as error:
                row[name] = {"error": str(error).splitlines()[0][:80] if str(error) else type(error).__name__}
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("repeats", type=int, help="times that each file is read, 1 or more; the fastest counts")
    parser.add_argument("files", nargs="*", metavar="PATH:FORMAT:WIDTH:HEIGHT")
    args = parser.parse_args()
    if args.repeats < 1:
        parser.error(f"REPEATS is {args.repeats}; it must be 1 or more")
    for file in args.files:
        if len(parts := file.rsplit(":", 3)) < 4 or not all(size.isdecimal() for size in parts[2:]):
            parser.error(f"{file!r} is not PATH:FORMAT:WIDTH:HEIGHT, as events.raw:evt3:1280:720")
    print(json.dumps(main(args.repeats, args.files)))
