"""Measures the error of events against the run time of whole graphs on one device, on eight scenes.

Run time is that of a graph in one process, as for the other rows. The events are those of the same graph held in
Python; they are compared with dense rendering on the same device, at some of the pixels, for there are millions of
events in a tenth of a second.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import evis
from bench.interpolation.between import DENSE, FRAMES, FURTHER, SCENES, TIME_TOLERANCES_S
from bench.throughput.attempts import Limits, NotRun, attempt
from bench.throughput.cases import Case
from bench.throughput.tables import unaudited
from evis.events.measure.distance import EventStream, victor_purpura
from evis.gpu.host_copies import host_array
from nodes.interpolator.auto.choice import frames_beside_samples

RATE = 30
GAPS = 3
"""Keyframe gaps whose events are compared."""
TRUTH = 512
"""Rendered frames in a gap of what others are compared with: 15,360 Hz."""
APART = 4
"""Of so many rows and columns one is compared."""
COLUMNS = ("run", "scene", "samples", "error", "events [%]", "RTF", "run time [ms]", "not measured")


def ways(scene: str, size: tuple[int, int]) -> list[tuple[str, Case]]:
    """Lists how a scene is sampled, with the family of each: frames, further samples, dense rendering."""
    frames = [(FRAMES, Case(scene, RATE, k, size=size)) for k in (8, 32)]
    further = [
        (FURTHER, Case(scene, RATE, frames_beside_samples(RATE, t), size=size, tolerance=t)) for t in TIME_TOLERANCES_S
    ]
    return [*frames, *further, *((DENSE, Case(scene, RATE * k, 1, size=size)) for k in (8, 32, 128))]


def stream(case: Case, device: str) -> EventStream:
    """Simulates GAPS gaps and returns the events of one in APART rows and columns."""
    given = case.args(device, time_tolerance=case.tolerance)
    del given["envs"]
    with evis.Simulation(case.scene, outputs=["events"], **given) as simulation:
        steps = [*simulation.run(GAPS / RATE), simulation.finish()]
    parts: list[list[np.ndarray]] = [[], [], [], []]
    for step in steps:
        if (events := step.events) is not None:
            fields = [host_array(getattr(events, name)) for name in "txyp"]
            chosen = (fields[1] % APART == 0) & (fields[2] % APART == 0)
            for part, field in zip(parts, fields):
                part.append(field[chosen])
    t, x, y, p = (np.concatenate(part) for part in parts)
    order = np.argsort(t, kind="stable")
    return EventStream(t[order], x[order] // APART, y[order] // APART, p[order], *(-(-n // APART) for n in case.size))


def rows(words: Sequence[str], size: tuple[int, int], device: str, limits: Limits) -> Iterator[dict[str, Any]]:
    """Measures every way of every scene that has one of the words in its name; without words of all."""
    for scene in SCENES:
        chosen = [(family, case) for family, case in ways(scene, size) if named(case, words)]
        truth = stream(Case(scene, RATE * TRUTH, 1, size=size), device) if chosen else None
        for family, case in chosen:
            assert truth is not None
            yield row(family, case, truth, device, limits)


def named(case: Case, words: Sequence[str]) -> bool:
    """Tells whether a case has one of the words in its name, or there are none."""
    return not words or any(word in case.name for word in words)


def row(family: str, case: Case, truth: EventStream, device: str, limits: Limits) -> dict[str, Any]:
    """Measures one way: spike-train error at 1/ms, events too many or lost, and run time of a gap of 1 / RATE s."""
    rate = f"{case.rate} Hz" if family == DENSE else f"{case.rate}x{case.upsampling}"
    within = f" {1e3 * case.tolerance:g} ms" if case.tolerance else ""
    cells: dict[str, Any] = dict.fromkeys(COLUMNS)
    cells |= {"run": case.name, "scene": case.scene, "samples": f"{rate} {family}{within}"}
    found = stream(case, device)
    cells["error"] = round(victor_purpura(found, truth, 1.0), 3)
    cells["events [%]"] = round(100 * (len(found.t) / max(len(truth.t), 1) - 1), 1)
    try:
        runs = [attempt(case, device, unaudited(case), limits, meter={"records": False}) for _ in range(limits.runs)]
    except NotRun as reason:
        return cells | {"not measured": str(reason)}
    factor = statistics.median(window["rtf"] for run in runs for window in run["meter"]["windows"])
    return cells | {"RTF": round(factor, 2), "run time [ms]": round(1e3 / (RATE * factor), 3)}
