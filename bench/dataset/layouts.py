"""Measures bytes per event of each layout of data sets, and how fast its events are written and read in windows.

    evis bench layouts [--quick]

All layouts get the same steps of spinning_disk at 346x260, without labels; what is no event (calibration, the camera's
description) is small beside them. Speeds are by the CPU time of one process, threads included.
"""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import evis
from bench import command
from evis.dataset.about import About
from evis.dataset.layouts import LAYOUTS, LayoutError, reader_of, writer_of
from evis.simulation.step import Step

WINDOW_NS = 50_000_000
RATE = 30.0


def simulated(seconds: float) -> tuple[About, list[Step]]:
    """Simulates spinning_disk for `seconds`; returns the description of the sequence and its steps."""
    outputs = ["events", "info"]
    with evis.Simulation("spinning_disk", outputs=outputs, seed=1, width=346, height=260) as sim:
        steps = [sim.reset(), *(sim.step() for _ in range(round(seconds * RATE)))]
    cameras = {name: info for name, outputs in steps[0].cameras.items() if (info := outputs.info) is not None}
    return About("disk", "spinning_disk", {}, 1, steps[-1].stamp_ns, RATE, cameras), steps


def row(layout: str, about: About, steps: Sequence[Step]) -> dict[str, Any]:
    """Measures bytes per event and the speeds of writing and reading of one layout; returns a row of the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "s"
        try:
            writer = writer_of(layout)(folder, about)
        except LayoutError as error:
            return {"layout": layout, "note": str(error)}
        began = time.process_time()
        for step in steps:
            writer.add(step)
        writer.close()
        wrote = time.process_time() - began
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        reader = reader_of(layout)(folder)
        edges = [*range(0, about.duration_ns, WINDOW_NS), about.duration_ns + 1]
        reader.events(0, WINDOW_NS)  # imports, and what is gone over once
        began = time.process_time()
        count = sum(len(reader.events(t0, t1).t) for t0, t1 in itertools.pairwise(edges))
        read = time.process_time() - began
    return {
        "layout": layout,
        "events [million]": round(count / 1e6, 2),
        "bytes per event": round(size / count, 2),
        "written [Mev/s]": round(count / wrote / 1e6, 1),
        "read in windows of 50 ms [Mev/s]": round(count / read / 1e6, 1),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures every layout whose packages are there."""
    about, steps = simulated(0.1 if quick else 0.5)
    return {
        "layouts": {
            "title": "Bytes per event of each layout of data sets",
            "command": "evis bench layouts",
            "rows": [row(layout, about, steps) for layout in LAYOUTS],
            "note": "spinning_disk, 346x260, without labels; CPU time of one process.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
