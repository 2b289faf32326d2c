"""Measures how fast windows of a data set are read beside h5py's bare read, and how fast they are simulated instead.

    evis bench loading [--quick]

h5py reads the same events, t, x, y and p whole, chunk after chunk, which is the least that anybody has to do. Each
figure is the best of several, of CPU time, as one process reads on one core and others may use the rest. PyTorch is not
needed.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py

import evis
from bench import command
from bench.dataset.making import recipe_text, run
from evis.dataset.loading.sequence import Sequence
from evis.dataset.loading.windows import Windows
from evis.files.hdf5_rows import blosc

WINDOW_S = 0.05
BATCH = 16
TRIES = 3


def fastest(what: Callable[[], Any]) -> float:
    """Returns the least CPU time of several [s]; the first one, which imports and warms up, does not count."""
    times = []
    for _ in range(TRIES + 1):
        began = time.process_time()
        what()
        times.append(time.process_time() - began)
    return min(times[1:])


def bare(sequence: Sequence) -> int:
    """Reads the four columns of an HDF5 file, 1 Mi events at a time; returns how many there were."""
    blosc()
    with h5py.File(sequence.folder / "events/left/events.h5") as file:
        columns = [file[f"events/{name}"] for name in "txyp"]
        count = int(columns[0].shape[0])
        for first in range(0, count, 1 << 20):
            for column in columns:
                column[first : first + (1 << 20)]
    return count


def gone_over(windows: Windows, shuffle: bool) -> None:
    """Reads all windows, and keeps none."""
    for i in windows.order(shuffle, 0):
        windows[int(i)]


def reading_row(layout: str, folder: Path) -> dict[str, Any]:
    """Measures how fast a data set in one layout is read in several ways [million events/s]; returns a row."""
    data = evis.dataset.open(folder)
    count = sum(sequence.count() for sequence in data)
    rates: dict[str, float] = {}

    def rate(name: str, what: Callable[[], Any]) -> None:
        rates[name] = count / fastest(what) / 1e6

    if layout == "dsec":
        rate("h5py's bare read", lambda: [bare(sequence) for sequence in data])
    rate("sequence.events()", lambda: [len(sequence.events().t) for sequence in data])
    windows = data.windows(seconds=WINDOW_S)
    grids = data.windows(seconds=WINDOW_S, representation="voxel_grid", bins=5)
    for name, which, shuffle in (("windows", windows, False), ("in random order", windows, True),
                                 ("voxel grids", grids, False)):  # fmt: skip
        rate(name, lambda which=which, shuffle=shuffle: gone_over(which, shuffle))  # type: ignore[misc]
    index = fastest(lambda: evis.dataset.open(folder).windows(seconds=WINDOW_S))
    by_number = fastest(lambda: evis.dataset.open(folder).windows(events=20_000))
    rounded = {f"{name} [Mev/s]": round(value, 1) for name, value in rates.items()}
    return {
        "layout": layout,
        "million events": round(count / 1e6, 1),
        **({} if layout == "dsec" else {"h5py's bare read [Mev/s]": None}),
        **rounded,
        "index [ms]": round(index * 1e3, 1),
        "index by number [ms]": round(by_number * 1e3, 1),
    }


def stream_row(recipe: Path, folder: Path, labels: list[str], sequences: int) -> dict[str, Any]:
    """Compares batches of a stream with the same ones from files [1/s]."""
    how: dict[str, Any] = {
        "seconds": 1 / 30, "representation": "voxel_grid", "bins": 5, "labels": labels, "arguments": ["omega"],
    }  # fmt: skip
    windows = evis.dataset.open(folder)[:sequences].windows(**how)
    stored = fastest(lambda: [len(batch) for batch in windows.batches(BATCH)])
    stream = evis.dataset.stream(recipe, sequences=sequences, arrays="numpy", **how)
    next(stream.batches(BATCH))  # with which kernels are there
    began = time.process_time()
    batches = sum(1 for _ in stream.batches(BATCH))
    simulated = time.process_time() - began
    stream.close()
    return {
        "batches of 16 windows of 1/30 s": "voxel grid" + (", " + ", ".join(labels) if labels else ""),
        "number": batches,
        "from files [1/s]": round(len(windows) / BATCH / stored, 1),
        "simulated [1/s]": round(batches / simulated, 2),
        "times as long": round(simulated / stored, 1),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures every case."""
    count = 2 if quick else 6
    with tempfile.TemporaryDirectory() as name:
        rows, streams = [], []
        for layout in ("dsec", "npz", "webdataset", "mcap"):
            folder = Path(name, layout)
            recipe = folder.with_suffix(".yaml")
            text = recipe_text(layout, "[forward_flow, boxes]" if layout == "npz" else "[]")
            recipe.write_text(text)
            run(["dataset", "make", str(recipe), "--count", str(count), "--out", str(folder)])
            rows.append(reading_row(layout, folder))
            if layout == "npz":
                streams = [stream_row(recipe, folder, labels, count) for labels in ([], ["forward_flow", "boxes"])]
    return {
        "reading": {
            "title": "Reading windows of 50 ms, million events a second",
            "command": "evis bench loading",
            "rows": rows,
            "note": "rotation.yaml, 346x260, 1 s a sequence. The files are in the system's cache. npz is mapped "
            "into memory: what is not touched is not read.",
        },
        "streaming": {
            "title": "Batches a second, simulated and read",
            "command": "evis bench loading",
            "rows": streams,
            "note": "One process, one core. `stream` simulates the same sequences that the files hold (layout npz).",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
