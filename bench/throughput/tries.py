"""Runs of a case, each in a process of its own with a timeout, and the row that they make."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import warp as wp

from bench.throughput.cases import Case

PROCESS = "from bench.throughput.run import main; main()"
"""What the process of a run does."""
LONG_S = 100_000.0
"""Simulated time of a run that its meter ends."""


@dataclass
class Limits:
    """Holds what a measurement may take. row_s: of one run [s]. until: time.monotonic() when no run begins any more.

    runs: of each case. windows, window_s: of each run.
    """

    row_s: float
    until: float
    runs: int = 1
    windows: int = 5
    window_s: float = 0.3


class NotRun(Exception):
    """Says why a run has no figures."""


def memory_gb(device: str) -> float:
    """Finds how much memory is free where a run keeps its arrays [GB]."""
    if device.startswith("cuda"):
        return float(wp.get_device(device).free_memory) / 1e9
    known = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
    return int(known["MemAvailable"].split()[0]) * 1024 / 1e9


def attempt(
    case: Case,
    device: str,
    args: Mapping[str, Any],
    limits: Limits,
    *,
    duration_s: float = LONG_S,
    meter: Mapping[str, Any] | None = None,
    environment: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Runs a case once and returns its summary, with `first_event_s` from the start of its process.

    Raises NotRun: no time or memory is left, it took too long, or it failed.
    """
    left = limits.until - time.monotonic()
    if left < 5:
        raise NotRun("no time was left")
    if (free := memory_gb(device)) < case.needs_gb:
        raise NotRun(f"needs {case.needs_gb:g} GB, and {free:.0f} GB are free")
    given = {"windows": limits.windows, "window_s": limits.window_s, "device": device} | dict(meter or {})
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if case.record and memory.is_dir() else None) as folder:
        asked = {"scene": case.scene, "args": case.args(device, **args), "meter": given, "duration_s": duration_s,
                 "record": str(Path(folder, "run.mcap")) if case.record else None}  # fmt: skip
        command = [sys.executable, "-c", PROCESS, json.dumps(asked)]
        allowed, began = min(limits.row_s, left), time.monotonic()
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=allowed,
                                  env=os.environ | dict(environment or {}))  # fmt: skip
        except subprocess.TimeoutExpired:
            raise NotRun(f"took longer than {allowed:.0f} s") from None
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        told = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise NotRun(f"failed: {told[-1]}")
    summary: dict[str, Any] = json.loads(lines[-1])
    if summary["failure"] is not None:
        raise NotRun(f"failed: {summary['failure'].splitlines()[0]}")
    at = [node["first_event_at"] for node in summary["nodes"].values() if node["first_event_at"]]
    return summary | {"first_event_s": min(at) - began if at else None}


def spread(values: list[float], digits: int = 2) -> dict[str, float]:
    """Gives median, min and max."""
    found = statistics.median(values), min(values), max(values)
    return {name: round(value, digits) for name, value in zip(("median", "min", "max"), found)}


def row(case: Case, device: str, limits: Limits) -> dict[str, Any]:
    """Measures a case by frames alone: several runs, of each several windows."""
    cells: dict[str, Any] = {"run": case.name}
    runs, why = [], ""
    for _ in range(limits.runs):
        try:
            runs.append(attempt(case, device, {"time_tolerance": 0, "audit": 0}, limits))
        except NotRun as reason:
            why = str(reason)
            break
    windows = [window for found in runs for window in found.get("meter", {}).get("windows", ())]
    if windows:
        scale = case.envs if case.together else 1
        cells |= {"unit": "env-s/s" if case.together else "RTF"}
        cells |= spread([scale * window["rtf"] for window in windows])
        if case.goal is not None and device != "cpu":
            cells |= {"goal": case.goal, "of the goal": f"{100 * cells['median'] / case.goal:.0f} %"}
        wall = statistics.median(window["wall_ms"] for window in windows)
        cells |= {"gap [ms]": round(wall, 3)}
        cells |= {"host [ms a gap]": round(statistics.median(window["host_ms"] for window in windows), 3)}
        cells |= _device(runs, wall)
        firsts = [found["first_event_s"] for found in runs if found["first_event_s"] is not None]
        cells |= {"first event [s]": round(min(firsts), 1)} if firsts else {}
        cells |= {"memory [MB]": round(max(found["rss_mb"] for found in runs))}
        cells |= {"windows": len(windows)}
    elif runs:
        why = "the run ended before a window was over"
    why = why or next(
        (f"GPU: {m['not_recorded']}" for m in (f.get("meter", {}) for f in runs) if "not_recorded" in m), ""
    )
    return cells | ({"not measured": why} if why else {}) | {"recorded": _kernels(runs)}


def _device(runs: list[dict[str, Any]], wall_ms: float) -> dict[str, Any]:
    """What the runs say of a GPU."""
    cells: dict[str, Any] = {}
    recorded = [found["meter"]["recorded"] for found in runs if "recorded" in found.get("meter", {})]
    busy = [1e3 * one["busy_s"] / one["gaps"] for one in recorded if one["busy_s"] is not None]
    if busy:
        cells = {"GPU [ms a gap]": round(statistics.median(busy), 3)}
        cells["GPU busy"] = f"{100 * min(1.0, statistics.median(busy) / wall_ms):.0f} %"
    memory = [found["meter"]["device_memory_gb"] for found in runs if "meter" in found]
    if memory and memory[0] is not None:
        cells["GPU memory [GB]"] = round(max(memory), 2)
    return cells


def _kernels(runs: list[dict[str, Any]]) -> dict[str, tuple[float, float]]:
    """Calls and milliseconds of a gap, of each kernel, as the last run has them."""
    for found in reversed(runs):
        recorded = found.get("meter", {}).get("recorded")
        if recorded:
            gaps = recorded["gaps"]
            return {name: (calls / gaps, 1e3 * s / gaps) for name, (calls, s) in recorded["kernels"].items()}
    return {}
