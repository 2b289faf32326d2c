"""The rows that runs of the cases make, table by table."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Mapping
from typing import Any

from bench.throughput import roofline
from bench.throughput.cases import Case
from bench.throughput.ceilings import Ceilings
from bench.throughput.tries import Limits, NotRun, attempt

FRAMES_ALONE = {"time_tolerance": 0, "audit": 0}
DEFAULT_S = 2.0
"""Simulated time of a run with the defaults [s]."""
Timed = Mapping[str, tuple[float, float]]
"""Symbol of a kernel -> calls and milliseconds of a gap."""


def spread(values: list[float], digits: int = 2) -> dict[str, float]:
    """Gives median, min and max."""
    found = statistics.median(values), min(values), max(values)
    return {name: round(value, digits) for name, value in zip(("median", "min", "max"), found)}


def frames_row(case: Case, device: str, limits: Limits) -> dict[str, Any]:
    """Measures a case by frames alone: several runs, of each several windows."""
    cells: dict[str, Any] = {"run": case.name}
    runs, why = [], ""
    for _ in range(limits.runs):
        try:
            runs.append(attempt(case, device, FRAMES_ALONE, limits))
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
    return cells | ({"not measured": why} if why else {}) | {"recorded": _timed(runs)}


def _device(runs: list[dict[str, Any]], wall_ms: float) -> dict[str, Any]:
    """What the runs say of a GPU, or of a CPU's kernels."""
    cells: dict[str, Any] = {}
    recorded = [found["meter"]["recorded"] for found in runs if "recorded" in found.get("meter", {})]
    if recorded:
        busy = statistics.median(1e3 * one["busy_s"] / one["gaps"] for one in recorded)
        what = "kernels" if recorded[0]["by"] == "launches" else "GPU"
        cells = {f"{what} [ms a gap]": round(busy, 3), f"{what} busy": f"{100 * min(1.0, busy / wall_ms):.0f} %"}
    memory = [found["meter"]["device_memory_gb"] for found in runs if "meter" in found]
    if memory and memory[0] is not None:
        cells["GPU memory [GB]"] = round(max(memory), 2)
    return cells


def _timed(runs: list[dict[str, Any]]) -> Timed:
    """Calls and milliseconds of a gap, of each kernel, as the last run has them."""
    for found in reversed(runs):
        recorded = found.get("meter", {}).get("recorded")
        if recorded:
            gaps = recorded["gaps"]
            return {name: (calls / gaps, 1e3 * s / gaps) for name, (calls, s) in recorded["kernels"].items()}
    return {}


def default_row(case: Case, device: str, limits: Limits) -> dict[str, Any]:
    """Measures a case with the defaults: real-time factor of the whole run, start-up apart, and error of its events."""
    cells: dict[str, Any] = {"run": case.name}
    runs = []
    try:
        for _ in range(limits.runs):
            runs.append(attempt(case, device, {}, limits, duration_s=DEFAULT_S, meter={"ends": False}))
    except NotRun as reason:
        cells["not measured"] = str(reason)
    if runs:
        cells |= spread([found["rtf"] for found in runs])
        audit = runs[0].get("audit", {})
        cells |= {"VP": audit.get("vp"), "from": audit.get("vp_low"), "to": audit.get("vp_high")}
        cells |= {"memory [MB]": round(max(found["rss_mb"] for found in runs))}
    return cells


def start_row(case: Case, device: str, limits: Limits) -> dict[str, Any]:
    """Measures the time to the first event with an empty cache of kernels and with a full one."""
    cells: dict[str, Any] = {"run": case.name}
    found: dict[str, list[float]] = {"empty cache": [], "full cache": []}
    meter = {"windows": 1, "window_s": 0.01, "warm_s": 0.0}
    try:
        for _ in range(limits.runs):
            with tempfile.TemporaryDirectory() as cache:
                there = {"WARP_CACHE_PATH": cache, "CUDA_CACHE_DISABLE": "1"}
                for times in found.values():
                    one = attempt(case, device, FRAMES_ALONE, limits, meter=meter, environment=there)
                    times.append(one["first_event_s"])
    except NotRun as reason:
        cells["not measured"] = str(reason)
    for name, times in found.items():
        if times:
            cells |= {f"{name} [s]": round(statistics.median(times), 1)}
            cells |= {f"{name}, min to max [s]": f"{min(times):.1f} to {max(times):.1f}"} if len(times) > 1 else {}
    return cells


def kernel_rows(kernels: dict[str, dict[str, tuple[float, float]]], most: int = 12) -> list[dict[str, Any]]:
    """Lists the longest kernels of each run, in milliseconds of a gap, and their share of all."""
    found = []
    for run, of_run in kernels.items():
        whole = sum(ms for _, ms in of_run.values())
        for name, (calls, ms) in list(of_run.items())[:most]:
            share = f"{100 * ms / whole:.1f} %"
            found.append(
                {
                    "run": run,
                    "kernel": roofline.short(name),
                    "calls a gap": round(calls, 2),
                    "ms a gap": round(ms, 4),
                    "share": share,
                }
            )
    return found


def roofline_rows(case: Case, device: str, limits: Limits, ceilings: Ceilings) -> list[dict[str, Any]]:
    """Measures what the kernels of a case take, counts what they do, and holds it against the ceilings."""
    try:
        timed = _timed([attempt(case, device, FRAMES_ALONE, limits, meter={"windows": 1})])
        with tempfile.TemporaryDirectory() as cache:
            there = {"WARP_CACHE_PATH": cache, "CUDA_CACHE_DISABLE": "1"}
            run = attempt(case, device, FRAMES_ALONE, limits, meter={"counts": True}, environment=there)
    except NotRun as reason:
        return [{"run": case.name, "not measured": str(reason)}]
    return roofline.rows(case.name, roofline.kernels_of(timed, run["meter"]["counted"]), ceilings)
