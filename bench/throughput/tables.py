"""Makes the rows of each table from runs of the cases."""

from __future__ import annotations

import compileall
import importlib.util
import statistics
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.roofline import kernels as roofline
from bench.roofline.ceilings import Ceilings
from bench.throughput.attempts import Limits, NotRun, attempt
from bench.throughput.cases import Case

FRAMES_COLUMNS = (
    "run", "unit", "median", "min", "max", "goal", "of the goal", "gap [ms]", "host [ms a gap]", "device [ms a gap]",
    "device busy", "device alone", "limit", "first event [s]", "GPU memory [GB]", "memory [MB]", "windows",
    "not measured",
)  # fmt: skip
DEFAULTS_COLUMNS = ("run", "median", "min", "max", "VP", "from", "to", "memory [MB]", "not measured")
DEFAULT_S = {True: 1.0, False: 5.0}
"""Simulated time of a run with the defaults [s], on a CPU and on a GPU."""
NEARLY_ALWAYS = 0.7
"""Share of a gap from which on the device is what limits a run."""
AUDITED = 64
"""Pixels that are audited where the defaults audit none."""
NO_WINDOWS = {"windows": 1 << 30, "ends": False}
Timed = Mapping[str, tuple[float, float]]
"""Symbol of a kernel -> calls and milliseconds of a gap."""


def unaudited(case: Case) -> dict[str, Any]:
    """Gives the arguments of a run without an audit, whose samples between frames the case decides."""
    return {"time_tolerance": case.tolerance, "audit": 0}


def spread(values: list[float], digits: int = 2) -> dict[str, float]:
    """Computes median, min and max."""
    found = statistics.median(values), min(values), max(values)
    return {name: round(value, digits) for name, value in zip(("median", "min", "max"), found)}


def frames_row(case: Case, device: str, limits: Limits) -> dict[str, Any]:
    """Measures a case in several runs, each with several windows.

    Returns the row, with `recorded`, the times of its kernels, which is no cell of it.
    """
    cells: dict[str, Any] = dict.fromkeys(FRAMES_COLUMNS) | {"run": case.name}
    runs = []
    try:
        for _ in range(limits.runs):
            runs.append(attempt(case, device, unaudited(case), limits))
    except NotRun as reason:
        cells["not measured"] = str(reason)
    meters = [found["meter"] for found in runs if "meter" in found]
    windows = [window for meter in meters for window in meter["windows"]]
    if not windows:
        cells["not measured"] = cells["not measured"] or "the run ended before a window was over"
        return cells | {"recorded": {}}
    scale = case.envs if case.speed_of_all else 1
    cells |= {"unit": "env-s/s" if case.speed_of_all else "RTF", "windows": len(windows)}
    cells |= spread([scale * window["rtf"] for window in windows])
    if case.goal is not None and device != "cpu":
        cells |= {"goal": case.goal, "of the goal": f"{100 * cells['median'] / case.goal:.0f} %"}
    wall, host = (statistics.median(window[name] for window in windows) for name in ("wall_ms", "host_ms"))
    cells |= {"gap [ms]": round(wall, 3), "host [ms a gap]": round(host, 3)}
    recorded = [meter["recorded"] for meter in meters if "recorded" in meter]
    if recorded:
        busy = statistics.median(1e3 * one["busy_s"] / one["gaps"] for one in recorded)
        cells |= {"device [ms a gap]": round(busy, 3), "device busy": f"{100 * min(1.0, busy / wall):.0f} %"}
        cells |= {"device alone": round(cells["median"] * max(1.0, wall / busy), 1), "limit": limit(meters, wall, busy)}
    else:
        why = next((meter["not_recorded"] for meter in meters if "not_recorded" in meter), None)
        cells["not measured"] = cells["not measured"] or (why and f"the device's time: {why}")
    if meters[0]["device_memory_gb"] is not None:
        cells["GPU memory [GB]"] = round(max(meter["device_memory_gb"] for meter in meters), 2)
    firsts = [found["first_event_s"] for found in runs if found["first_event_s"] is not None]
    cells["first event [s]"] = round(min(firsts), 1) if firsts else None
    cells["memory [MB]"] = round(max(found["rss_mb"] for found in runs))
    return cells | {"recorded": _timed(runs)}


def limit(meters: Sequence[Mapping[str, Any]], wall: float, busy: float) -> str:
    """Says what a gap's time [ms] goes to most: a node of the host, or a kernel where the device is hardly ever idle.

    meters: of the runs, what they have measured. busy: time of a gap in which the device did anything [ms].
    """
    if busy < NEARLY_ALWAYS * wall:
        nodes = meters[-1]["nodes_ms"]
        node = max(nodes, key=lambda name: float(nodes[name]))
        return f"host: {node} {100 * nodes[node] / sum(nodes.values()):.0f} %"
    kernels = next(meter["recorded"]["kernels"] for meter in reversed(meters) if "recorded" in meter)
    whole = sum(seconds for _, seconds in kernels.values())
    name, (_, seconds) = next(iter(kernels.items()))
    return f"device: {roofline.short(name)} {100 * seconds / whole:.0f} %"


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
    cells: dict[str, Any] = dict.fromkeys(DEFAULTS_COLUMNS) | {"run": case.name}
    runs = []
    try:
        for _ in range(limits.runs):
            seconds = DEFAULT_S[device == "cpu"]
            runs.append(attempt(case, device, {}, limits, duration_s=seconds, meter=NO_WINDOWS))
    except NotRun as reason:
        cells["not measured"] = str(reason)
    if runs:
        cells |= spread([found["rtf"] for found in runs])
        audit = runs[0].get("audit", {})
        if audit.get("vp") is None:
            audit = _audited(case, device, limits)
        cells |= {name: audit.get(key) for name, key in (("VP", "vp"), ("from", "vp_low"), ("to", "vp_high"))}
        cells |= {"memory [MB]": round(max(found["rss_mb"] for found in runs))}
    return cells


def _audited(case: Case, device: str, limits: Limits) -> dict[str, Any]:
    """What an audit says of a case that has none by default, as on a GPU, in a run of its own."""
    try:
        found = attempt(case, device, {"audit": AUDITED}, limits, duration_s=DEFAULT_S[True], meter=NO_WINDOWS)
    except NotRun:
        return {}
    return found.get("audit", {})


INSTALLED = ("evis", "nodes", "msgs", "bench", "warp", "numpy", "zmq")
"""Packages of which an installation has byte code; without it a start would measure Python's compiler."""


def compile_byte_code() -> None:
    """Compiles the modules that a start imports to byte code, where there is none yet and it can be written."""
    for name in INSTALLED:
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            compileall.compile_dir(Path(spec.origin).parent, quiet=2)


def start_row(case: Case, device: str, limits: Limits) -> dict[str, Any]:
    """Measures the time to the first event with an empty cache of kernels and with a full one."""
    compile_byte_code()
    cells: dict[str, Any] = {"run": case.name}
    found: dict[str, list[float]] = {"empty cache": [], "full cache": []}
    # What records the device is loaded when the windows are over: after the first event, which comes with a batch.
    meter = {"windows": 1, "warm_s": 1.0}
    try:
        for _ in range(limits.runs):
            with tempfile.TemporaryDirectory() as cache:
                (Path(cache) / "cuda").mkdir()
                there = {"WARP_CACHE_PATH": f"{cache}/warp", "CUDA_CACHE_PATH": f"{cache}/cuda"}
                for times in found.values():
                    one = attempt(case, device, unaudited(case), limits, meter=meter, environment=there)
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
    """Measures the time, bytes and operations of the kernels of a case, and compares them with the ceilings."""
    try:
        timed = _timed([attempt(case, device, unaudited(case), limits, meter={"windows": 1})])
        with tempfile.TemporaryDirectory() as cache:
            there = {"WARP_CACHE_PATH": cache, "CUDA_CACHE_DISABLE": "1"}
            run = attempt(case, device, unaudited(case), limits, meter={"counts": True}, environment=there)
    except NotRun as reason:
        return [{"run": case.name, "not measured": str(reason)}]
    return roofline.rows(case.name, roofline.kernels_of(timed, run["meter"]["counted"]), ceilings)
