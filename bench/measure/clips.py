"""Measures the error of `evis events measure` on six clips of a wheel flicked by hand, against their reference.

`EVIS_TEST_DATA=DIR python -m bench.measure.clips`, DIR being the folder that holds wheel/.
"""

from __future__ import annotations

import csv
import os
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from bench import command
from evis.events import open_recording
from evis.events.measure import Measurement

COMMAND = "EVIS_TEST_DATA=DIR python -m bench.measure.clips"


def row(path: Path, at: np.ndarray, wanted: np.ndarray) -> tuple[dict[str, Any], np.ndarray]:
    """Measures a clip; returns a row of the table, and the relative error at each stamp of the reference.

    at: stamps of the reference [us from the first event]; wanted: its speeds [rad/s]."""
    with open_recording(path) as recording:
        events = recording.read()
        measurement = Measurement(recording.info.width, recording.info.height)
    measurement.add(events.t, events.x, events.y, events.p)
    found = measurement.report()["rotation"]
    t = (np.array([stamp for stamp, _ in found["series"]]) - events.t[0]) / 1e3
    omega = np.array([speed for _, speed in found["series"]])
    error = np.abs(np.interp(at, t, omega) / wanted - 1)
    inside = (t >= at[0]) & (t <= at[-1])
    back = np.abs(omega[inside] / np.interp(t[inside], at, wanted) - 1)
    result: dict[str, Any] = {"clip": path.name[17:25], "samples": len(at), "confidence": found["confidence"]}
    result |= {"median [%]": round(100 * float(np.median(error)), 1)}
    result |= {"p95 at its stamps [%]": round(100 * float(np.percentile(error, 95)), 1)}
    return result | {"p95 at ours [%]": round(100 * float(np.percentile(back, 95)), 1)}, error


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures the deviation by clip, and of all samples together."""
    folder = Path(os.environ.get("EVIS_TEST_DATA", "")) / "wheel"
    table = folder / "reference_speed.csv"
    if not table.exists():
        raise SystemExit(f"no {table}; set EVIS_TEST_DATA to the folder of the recordings")
    clips: dict[str, list[tuple[float, float]]] = defaultdict(list)
    with table.open() as lines:
        for sample in csv.DictReader(lines):
            clips[sample["file"]].append((float(sample["t_us_rel_first_event"]), float(sample["omega_rad_s"])))
    rows, errors = [], []
    for name in list(clips)[: 1 if quick else None]:
        found, error = row(folder / name, *np.array(clips[name]).T)
        rows.append(found)
        errors.append(error)
    every = np.concatenate(errors)
    rows.append({"clip": "together", "samples": len(every), "median [%]": round(100 * float(np.median(every)), 1),
                 "p95 at its stamps [%]": round(100 * float(np.percentile(every, 95)), 1)})  # fmt: skip
    note = "Relative to the reference, as it is. Eight samples of 11_35_50 are wrong in it: docs/measure.md."
    section = {"title": "Rotation speed of a real wheel", "note": note, "command": COMMAND, "rows": rows}
    return {"measure_clips": section}


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
