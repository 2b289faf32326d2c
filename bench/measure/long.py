"""Measures memory and CPU time of `evis events measure` on long streams, against the number of events.

`python -m bench.measure.long`. A disk of 420 px in 640x480 that turns twice a second, over and over; each length in a
process of its own, fed block by block as from a file.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from typing import Any

import numpy as np

from bench import command
from bench.measure.disks import BLOCK, Case, events, texture
from evis.events.measure import Measurement

COMMAND = "python -m bench.measure.long"
LOOP_NS = 500_000_000
"""One revolution."""


def case() -> Case:
    """Makes one revolution, with noise of 5 Hz per pixel."""
    return Case("", lambda t: 4 * np.pi + 0 * t, texture(210.0), 0.5, (640, 480), (320.0, 240.0), noise_hz=5.0)


def resident() -> int:
    """Returns the memory of this process [bytes]."""
    with open("/proc/self/statm") as status:
        return int(status.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def one(wanted: int) -> dict[str, Any]:
    """Measures memory, CPU time and speed on a stream of at least `wanted` events.

    Memory is looked at after each block and all the way through a fit.
    """
    loop = events(case())
    before = peak = resident()

    def look(text: str = "") -> None:
        nonlocal peak
        peak = max(peak, resident())

    measurement, fed, turn = Measurement(640, 480, working=look), 0, 0
    began = time.process_time()
    while fed < wanted:
        for i in range(0, len(loop[0]), BLOCK):
            t, x, y, p = (v[i : i + BLOCK] for v in loop)
            measurement.add(t + turn * LOOP_NS, x, y, p)
            look()
        fed, turn = fed + len(loop[0]), turn + 1
    found = measurement.report()["rotation"]
    cpu = time.process_time() - began
    return {
        "events": fed,
        "of the stream [s]": turn * LOOP_NS * 1e-9,
        "speed [rad/s]": round(found["omega_rad_s"], 3),
        "CPU [s]": round(cpu, 1),
        "CPU [ns/event]": round(1e9 * cpu / fed),
        "memory [MB]": round((peak - before) / 2**20),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures memory and time by length."""
    rows = []
    for wanted in (2_000_000, 10_000_000) if quick else (2_000_000, 10_000_000, 100_000_000):
        done = subprocess.run(
            [sys.executable, "-m", "bench.measure.long", "--one", str(wanted)], capture_output=True, check=True
        )
        rows.append(json.loads(done.stdout))
    note = "True speed 12.566 rad/s. Memory: the most that measuring added to its process."
    section = {"title": "Measuring long streams", "note": note, "command": COMMAND, "rows": rows}
    return {"measure_long": section}


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(one(int(sys.argv[2]))))
    else:
        command.run(measure, __doc__ or "")
