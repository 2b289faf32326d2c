"""Whole runs on one device: speed, how busy the device is, time of the host, memory, first event.

    python -m bench.gpu_graph [--quick] [--rows WORD,...] [--json] [--out FILE] [--device cuda]

Every row is a run of `evis launch --compose --no-view` in a process of its own. Windows of some tenths of a second are
measured in it after its first gaps; afterwards all that a GPU does is recorded for some gaps (by CUPTI where PyTorch is
installed). Without a GPU it measures the CPU. --rows warehouse,60x4 takes the rows with these words in their names.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Sequence
from typing import Any

import warp as wp

from bench import command
from bench.throughput.cases import CASES, DEFAULTS, STARTS, Case, chosen
from bench.throughput.tries import Limits, NotRun, attempt, row, spread

COMMAND = "python -m bench.gpu_graph"
SECTIONS = ("frames", "defaults", "starts")
DEFAULT_S = 2.0
"""Simulated time of a run with the defaults [s]."""


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
                    one = attempt(
                        case, device, {"time_tolerance": 0, "audit": 0}, limits, meter=meter, environment=there
                    )
                    times.append(one["first_event_s"])
    except NotRun as reason:
        cells["not measured"] = str(reason)
    for name, times in found.items():
        if times:
            cells |= {f"{name} [s]": round(statistics.median(times), 1)}
            cells |= {f"{name}, min to max [s]": f"{min(times):.1f} to {max(times):.1f}"} if len(times) > 1 else {}
    return cells


def measure(quick: bool = False, device: str = "auto", rows: Sequence[str] = (), sections: Sequence[str] = SECTIONS,
            timeout: float = 0.0, budget: float = 3600.0) -> dict[str, Any]:  # fmt: skip
    """Measures the runs.

    Args:
        quick: fewer rows, one run of each.
        device: `auto` is a GPU where there is one, otherwise the CPU.
        rows: words of the rows that are wanted.
        sections: names of the tables that are wanted.
        timeout: seconds that a run may take, 0 = 60 (180 when not quick).
        budget: seconds after which no other run is begun.
    """
    device = ("cuda" if wp.is_cuda_available() else "cpu") if device == "auto" else device
    name = wp.get_device(device).name
    until = time.monotonic() + budget
    limits = Limits(timeout or (60.0 if quick else 180.0), until, *((1, 5, 0.25) if quick else (3, 3, 0.5)))
    title = f"640x480, one process, {name}"
    made: dict[str, Any] = {}
    if "frames" in sections:
        found = [row(case, device, limits) for case in chosen(CASES, rows, quick)]
        kernels = {one["run"]: one.pop("recorded") for one in found}
        made["frames"] = {
            "title": f"Frames alone (time_tolerance:=0 audit:=0), {title}",
            "rows": found,
            "note": "Of the windows of all runs. env-s/s: simulated seconds of all environments together in a second. "
            "host: a gap's time without that in which the host waited for the GPU. GPU: time in which it did anything.",
        }
        made["kernels"] = {"title": f"What the GPU's time goes to, {title}", "rows": kernel_rows(kernels), "note": ""}
    if "defaults" in sections:
        made["defaults"] = {
            "title": f"Defaults, {title}",
            "rows": [default_row(case, device, limits) for case in chosen(DEFAULTS, rows, quick)],
            "note": f"Real-time factor of {DEFAULT_S:g} simulated seconds after start-up; VP as the audit has it.",
        }
    if "starts" in sections:
        made["starts"] = {
            "title": f"From the command to the first event, {title}",
            "rows": [start_row(case, device, limits) for case in chosen(STARTS, rows, quick)],
            "note": "Kernels compiled anew, and found in Warp's cache.",
        }
    return {key: section | {"command": COMMAND} for key, section in made.items() if section["rows"]}


def kernel_rows(kernels: dict[str, dict[str, tuple[float, float]]], most: int = 12) -> list[dict[str, Any]]:
    """Lists the longest kernels of each run, in milliseconds of a gap, and their share of all."""
    found = []
    for run, of_run in kernels.items():
        whole = sum(ms for _, ms in of_run.values())
        for name, (calls, ms) in list(of_run.items())[:most]:
            share = f"{100 * ms / whole:.1f} %"
            found.append(
                {"run": run, "kernel": name, "calls a gap": round(calls, 2), "ms a gap": round(ms, 4), "share": share}
            )
    return found


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declares what chooses rows and bounds the time."""
    words = lambda text: tuple(word.strip() for word in text.split(",") if word.strip())
    parser.add_argument(
        "--rows", type=words, default=(), metavar="WORD,...", help="rows with one of these in their name"
    )
    parser.add_argument(
        "--sections", type=words, default=SECTIONS, metavar="NAME,...", help=f"of {', '.join(SECTIONS)}"
    )
    parser.add_argument("--timeout", type=float, default=0.0, metavar="S", help="seconds that one run may take")
    parser.add_argument("--budget", type=float, default=3600.0, metavar="S", help="seconds after which no run is begun")


if __name__ == "__main__":
    command.run(measure, __doc__ or "", device="auto", options=add_options)
