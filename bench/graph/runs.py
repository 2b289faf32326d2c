"""Measures whole graphs: real-time factor, CPU time of each node, cost of the graph itself, and what omissions save.

    evis bench graph [--quick]

CPU time is counted per process, kernel and ZeroMQ threads included; what is not
spent inside a node's own calls is the graph's overhead (bus, codec, scheduling).
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

from bench import command

NODES = ("physics", "renderer", "interpolator", "event_sensor", "labeler", "recorder")


def launch(scene: str, *args: str, duration: float | None = None) -> dict[str, Any]:
    """Runs `evis launch` as a process and returns its summary. Raises RuntimeError with its error text.

    duration: of --duration [s]; none for a graph whose source ends by itself.
    """
    words = ["evis", "launch", scene, *args, "--no-view", "--json"]
    words += ["--duration", str(duration)] if duration is not None else []
    started = time.monotonic()
    result = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True)
    if result.returncode:
        raise RuntimeError(f"{' '.join(words)}: {result.stderr.strip()}")
    summary = json.loads(result.stdout.strip().splitlines()[-1])
    first = min((n["first_event_at"] for n in summary["nodes"].values() if n["first_event_at"]), default=started)
    return summary | {"first_event_s": first - started}


def overhead(summary: dict[str, Any]) -> float:
    """Computes the share of the graph's CPU time that no node spent itself."""
    own = sum(node["cpu_s"] for name, node in summary["nodes"].items() if name in NODES)
    return 1.0 - own / summary["cpu_s"] if summary["cpu_s"] else 0.0


def row(name: str, summary: dict[str, Any]) -> dict[str, Any]:
    """Makes a row of the table from the summary of a run."""
    cells: dict[str, Any] = {
        "run": name,
        "real-time factor": round(summary["rtf"], 2),
        "overhead": f"{100 * overhead(summary):.1f} %",
        "start-up [s]": round(summary["startup_s"], 2),
        "first event [s]": round(summary["first_event_s"], 2),
        "memory [MB]": round(summary["rss_mb"]),
        "events": summary["events"],
    }
    cells |= {
        f"{n} [ms]": round(1e3 * summary["nodes"][n]["cpu_s"] / summary["keyframes"], 2)
        for n in NODES
        if n in summary["nodes"]
    }
    return cells


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures spinning_disk in every arrangement, and with and without what a scene can leave out."""
    duration = 1.0 if quick else 5.0
    launch("spinning_disk", duration=0.1)  # kernels are compiled now, whatever ran before
    large = ("width:=640", "height:=480")
    arrangements = {
        "346x260, default processes": (),
        "346x260, one process": ("--compose",),
        "346x260, every node alone": ("--split",),
        "640x480, one process": (*large, "--compose"),
        "640x480, default processes": large,
        "640x480, every node alone": (*large, "--split"),
    }
    variants = {
        "as it is": (),
        "all labels": ("labels:=flow,depth,segmentation,boxes,poses,velocities",),
        "dense, 240 keyframes/s, no interpolator": ("keyframe_rate:=240", "upsampling:=1"),
        "four environments": ("envs:=4",),
    }
    return {
        "arrangements": {
            "title": "spinning_disk, 30 keyframes/s x 8, CPU milliseconds per keyframe and node",
            "command": "evis bench graph",
            "rows": [
                row(name, launch("spinning_disk", *args, duration=duration)) for name, args in arrangements.items()
            ],
            "note": "overhead: CPU time of all processes that no node spent itself. First event: from the start of the "
            "command, kernels compiled before.",
        },
        "omissions": {
            "title": "What a scene leaves out, one process, 346x260",
            "command": "evis bench graph",
            "rows": [
                row(name, launch("spinning_disk", "--compose", *args, duration=duration))
                for name, args in variants.items()
            ],
            "note": "The planner leaves the labeler, normals and the physics engine out of the first row.",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
