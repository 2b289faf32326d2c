"""Decoding speed of event streams: the Warp kernels and their numpy twins, next to the evt3 library."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from evis.streams import Events, evt2, evt3
from evis.streams.raw import read_header

RECORDINGS = {"evt3": "derived/gen31_vga_from_bag1.raw", "evt2": "prophesee/faery_evt2.raw"}
CODECS: dict[str, Any] = {"evt2": evt2, "evt3": evt3}


def synthetic(n: int, width: int = 1280, height: int = 720) -> Events:
    """Rows of neighbouring pixels that fire together, as an edge does: about 8 events per row and time."""
    rng = np.random.default_rng(1)
    groups = n // 8
    t = np.repeat(np.cumsum(rng.integers(0, 3, groups)), 8) * 1000
    x = np.repeat(rng.integers(0, width // 32, groups) * 32, 8) + np.tile(np.arange(0, 32, 4), groups)
    y = np.repeat(rng.integers(0, height, groups), 8)
    return Events.of(t, x, y, np.repeat(rng.integers(0, 2, groups), 8))


def cpu_seconds(work: Callable[[], Any], repeats: int) -> float:
    """Median CPU time [s] of one call, after one call that is not counted (imports, compilation)."""
    work()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return max(statistics.median(times), 1e-9)


def streams(quick: bool) -> list[tuple[str, str, bytes, int, int]]:
    """(name, encoding, words, width, height) of what is decoded; real recordings only where they are at hand."""
    folder = Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[2] / "shared" / "data"))
    result = []
    for encoding, name in RECORDINGS.items():
        path = folder / name
        if path.exists():
            with path.open("rb") as file:
                read_header(file)
                result.append((f"real VGA {encoding.upper()}", encoding, file.read(), 640, 480))
    events = synthetic(300_000 if quick else 3_000_000)
    for encoding, codec in CODECS.items():
        result.append((f"synthetic HD {encoding.upper()}", encoding, codec.Encoder().encode(events), 1280, 720))
    return result


def decode(encoding: str, width: int, height: int, data: bytes, backend: str) -> Events:
    """All events of a stream."""
    return CODECS[encoding].Decoder(width, height, backend).decode(data)


def measure(quick: bool = False) -> dict[str, Any]:
    """Million events per second of CPU time, by stream and decoder; ratios are safer than the numbers."""
    repeats = 3 if quick else 7
    rows = []
    for name, encoding, data, width, height in streams(quick):
        n = len(decode(encoding, width, height, data, "numpy"))
        row: dict[str, Any] = {"stream": name, "events": n, "bytes per event": round(len(data) / n, 2)}
        for backend in ("warp", "numpy"):
            work = partial(decode, encoding, width, height, data, backend)
            row[f"{backend} Mev/s"] = round(n / cpu_seconds(work, repeats) / 1e6, 1)
        if encoding == "evt3" and (library := _library(data, width, height)):
            row["evt3 library Mev/s"] = round(n / cpu_seconds(library, repeats) / 1e6, 1)
            row["warp / library"] = round(row["warp Mev/s"] / row["evt3 library Mev/s"], 2)
        row["warp / numpy"] = round(row["warp Mev/s"] / row["numpy Mev/s"], 1)
        rows.append(row)
    events = synthetic(300_000 if quick else 3_000_000)

    def encode(codec: Any) -> bytes:
        return codec.Encoder().encode(events)

    encoding_rows = [
        {"encoder": name.upper(), "Mev/s": round(len(events) / cpu_seconds(partial(encode, codec), repeats) / 1e6, 1)}
        for name, codec in CODECS.items()
    ]
    command = "evis bench streams" + (" --quick" if quick else "")
    return {
        "decoding": {
            "title": "Decoding, million events per second of CPU time",
            "command": command,
            "rows": rows,
            "note": "One core, bytes to arrays t, x, y, p; the Warp kernel and numpy give the same bits.",
        },
        "encoding": {"title": "Encoding (numpy)", "command": command, "rows": encoding_rows, "note": ""},
    }


def _library(data: bytes, width: int, height: int) -> Callable[[], Any] | None:
    try:
        import evt3 as library
    except ImportError:
        return None
    return lambda: library.Decoder(width, height).feed(data)


if __name__ == "__main__":
    import json
    import sys

    print(json.dumps(measure("--quick" in sys.argv), indent=1))
