"""Runs a case in a process of its own with a timeout, and returns its summary or says why there is none."""

from __future__ import annotations

import json
import os
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
"""Code of the process of a run."""
LONG_S = 100_000.0
"""Simulated time of a run that its meter ends."""


@dataclass
class Limits:
    """Limits how long a measurement takes, and how often it runs.

    row_s: longest time of a run [s]. until: time.monotonic() from which no run begins. runs: of each case. windows,
    window_s: how many of each run are measured, and how long one is [s].
    """

    row_s: float
    until: float
    runs: int = 1
    windows: int = 5
    window_s: float = 0.3


class NotRun(Exception):
    """Signals that a run has no figures; its text says why."""


def memory_gb(device: str) -> float:
    """Measures how much memory is free where a run keeps its arrays [GB]."""
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
    given = {"windows": limits.windows, "window_s": limits.window_s, "measured": device} | dict(meter or {})
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
