"""Measures frames per CPU second beside other simulators, and the time that each fault of the sensor adds."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from bench.event_sensor import disk
from bench.event_sensor.peers import DISK, QUOTED, esim_core
from bench.event_sensor.sensing import FRAMES_A_CALL, MODELS, C, Make, crossings, evis, model, run_esim, section, sense
from bench.event_sensor.signals import stamps
from evis.events.measure.distance import EventStream
from nodes.event_sensor.parameters import CROSSINGS
from nodes.event_sensor.peers.v2e import NOISY

FAULTS: dict[str, dict[str, Any]] = {
    "threshold mismatch": {"threshold_mismatch": 0.05},
    "refractory period": {"refractory_us": 100.0},
    "leak": {"leak_rate": 0.1, "leak_jitter": 0.1},
    "shot noise": {"shot_rate": 5.0, "shot_white": 100.0},
    "hot pixels": {"hot_pixel_fraction": 0.001, "hot_pixel_rate": 100.0},
    "defocus": {"defocus_px": 0.5},
}
"""The faults of the paper, at about the strength of v2e's preset "noisy"."""
BEYOND: dict[str, dict[str, Any]] = {
    "photoreceptor bandwidth": {"bandwidth_hz": 300.0, "bandwidth_level": 100.0},
    "readout jitter": {"timestamp_jitter_us": 5.0},
}
"""Faults that the paper's model does not have."""
ALL: dict[str, Any] = {name: value for fault in FAULTS.values() for name, value in fault.items()}


def speed(quick: bool) -> dict[str, Any]:
    """Measures frames per CPU second on the disk, and the number of events, beside other simulators."""
    t = stamps(1000, 0.039 if quick else 0.199)
    frames = disk.record(t, 1.0)
    truth = disk.reference_events(frames.luminance, t, C)
    repeats = 1 if quick else 3
    rows: list[dict[str, Any]] = []

    def add(name: str, make: Make, slopes: bool = False, a_call: int = FRAMES_A_CALL, plain: bool = True) -> None:
        runs = [sense(make, frames, slopes, a_call) for _ in range(repeats if name.startswith("evis") else 1)]
        rows.append(_speed_row(name, len(t), [spent for _, spent in runs], runs[0][0], truth if plain else None))

    for name, (make, slopes) in crossings().items():
        add(name, make, slopes)
    add("evis, linear, one frame a call", evis(), a_call=1)
    core = esim_core()
    if core is not None:
        runs = [run_esim(core, frames) for _ in range(repeats)]
        rows.append(_speed_row("esim_py core", len(t), [spent for _, spent in runs], runs[0][0], truth))
    for name, params in MODELS.items():
        add(f"{name} (our own code)", model(name, **params))
    add("evis, the paper's six faults", evis(**ALL), plain=False)
    everything = ALL | {name: value for fault in BEYOND.values() for name, value in fault.items()}
    add("evis, those, photoreceptor and readout", evis(**everything), plain=False)
    add("v2e noisy preset (our own code)", model("v2e", **NOISY, shot_white=1000.0), plain=False)
    for name, rate, error in DISK:
        rows.append({"simulator": name, "source": QUOTED, "frames/s": rate, "events against truth [%]": error})
    base = next((r["frames/s"] for r in rows if r["simulator"] == "esim_py core" and r["source"] == "this run"), None)
    for row in rows:
        if base and row["source"] == "this run":
            row["x esim_py core"] = round(row["frames/s"] / base, 2)
    note = f"640 x 480 float32, {len(t)} frames at 1 kHz, {len(truth.t)} events in float64 with whole levels, "
    note += f"{len(truth.t) / len(t):.0f} a frame; up to 8 per pixel and frame. Median of {repeats}, "
    note += "of the other models one run. "
    note += "quoted: the authors' own programs on another machine, frames of the same description, 4,419,506 events."
    return {"disk": section("Speed on the high-dynamic-range disk, one core", rows, note)}


def _speed_row(
    name: str, frames: int, spent: list[float], events: EventStream, truth: EventStream | None
) -> dict[str, Any]:
    middle = float(np.median(spent))
    row: dict[str, Any] = {"simulator": name, "source": "this run", "frames/s": round(frames / middle, 1)}
    row |= {"CPU [s]": round(middle, 3), "events": len(events.t), "Mev/s": round(len(events.t) / middle / 1e6, 2)}
    if truth is not None:
        row["events against truth [%]"] = round(100 * (len(events.t) / len(truth.t) - 1), 4)
        pixels = [np.bincount(s.y.astype(int) * s.width + s.x, minlength=s.width * s.height) for s in (events, truth)]
        row["pixels that differ [%]"] = round(100 * float((pixels[0] != pixels[1]).mean()), 3)
    return row


def omissions(quick: bool) -> dict[str, Any]:
    """Measures what each fault adds to a frame of the disk, one at a time and all together."""
    t = stamps(1000, 0.039 if quick else 0.099)
    frames = disk.record(t, 1.0)
    repeats = 1 if quick else 3
    cases: dict[str, dict[str, Any]] = {"none": {}, **FAULTS, **BEYOND, "the paper's six": ALL}
    cases |= {f"crossing {name}": {"crossing": name} for name in CROSSINGS}
    rows: list[dict[str, Any]] = []
    for name, params in cases.items():
        runs = [sense(evis(**params), frames, params.get("crossing") == "hermite") for _ in range(repeats)]
        ms = 1e3 * float(np.median([spent for _, spent in runs])) / len(t)
        rows.append({"with": name, "ms a frame": round(ms, 3), "events a frame": round(len(runs[0][0].t) / len(t))})
        rows[-1]["x none"] = round(ms / rows[0]["ms a frame"], 2)
    settings = "; ".join(f"{name}: {json.dumps(value)}" for name, value in {**FAULTS, **BEYOND}.items())
    note = f"640 x 480, {len(t)} frames at 1 kHz, {FRAMES_A_CALL} a call. What is not asked for is not compiled in. "
    return {"omissions": section("What each fault costs", rows, note + settings)}
