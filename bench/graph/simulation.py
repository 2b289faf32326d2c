"""Measures evis.Simulation: what a step costs above its nodes, and how long starting and resetting take.

    evis bench simulation [--quick]

Time is the CPU's of the calling thread, which is all that a closed graph uses with threads:=1, so that other programs
of the machine count less than by the clock.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from typing import Any

import evis
from bench import command

SIZES = ((64, 64), (346, 260))
SCENES = ("spinning_disk", "robot_arm")
BATCHES = 5
FIRST = """
import json, time
began = time.process_time()
import evis
times = []
for _ in range(3):
    start = time.process_time() if times else began
    sim = evis.Simulation({scene!r}, width={width}, height={height})
    sim.reset()
    times.append(time.process_time() - start)
    sim.close()
print(json.dumps(times))
"""


def own_time(sim: evis.Simulation) -> float:
    """Adds up the CPU time [s] that the nodes have spent since the last reset."""
    return float(sum(node["cpu_s"] for name, node in sim.summary().items() if name != "caller"))


def step_row(scene: str, width: int, height: int, steps: int) -> dict[str, Any]:
    """Measures steps in batches, and gives the median batch."""
    with evis.Simulation(scene, width=width, height=height) as sim:
        sim.reset()
        for _ in range(5):
            sim.step()
        batches = []
        for _ in range(BATCHES):
            nodes, began = own_time(sim), time.thread_time()
            for _ in range(steps):
                sim.step()
            whole = time.thread_time() - began
            batches.append((whole, own_time(sim) - nodes))
        resets = []
        for _ in range(9):
            began = time.thread_time()
            sim.reset()
            resets.append(time.thread_time() - began)
            sim.step()
    whole, nodes = sorted(batches, key=lambda batch: batch[0] / batch[1])[BATCHES // 2]
    return {
        "scene": scene,
        "size": f"{width}x{height}",
        "step [ms]": round(1e3 * whole / steps, 3),
        "its nodes [ms]": round(1e3 * nodes / steps, 3),
        "above them": f"{100 * (whole / nodes - 1):.1f} %",
        "reset of all [ms]": round(1e3 * statistics.median(resets), 2),
    }


def start_row(scene: str, width: int, height: int) -> dict[str, Any]:
    """Measures, in a process of its own, the first Simulation with all imports, and those after it."""
    code = FIRST.format(scene=scene, width=width, height=height)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    first, second, third = json.loads(done.stdout.splitlines()[-1])
    return {
        "scene": scene,
        "size": f"{width}x{height}",
        "first [s]": round(first, 2),
        "second [s]": round(second, 3),
        "third [s]": round(third, 3),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures steps and starts of two scenes in two sizes."""
    steps = 20 if quick else 100
    cases = [(scene, *size) for scene in SCENES for size in SIZES]
    rows = [step_row(*case, steps) for case in cases]  # kernels are compiled now, whatever ran before
    return {
        "steps": {
            "title": "A step of evis.Simulation, 30 keyframes/s x 8, events alone",
            "command": "evis bench simulation",
            "rows": rows,
            "note": "CPU time of the calling thread; the median of five batches. A reset of all environments ends with "
            "keyframe 0.",
        },
        "starts": {
            "title": "From nothing to keyframe 0",
            "command": "evis bench simulation",
            "rows": [start_row(*case) for case in cases],
            "note": "CPU time of the process, kernels compiled before; the first one with the imports.",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
