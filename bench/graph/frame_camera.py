"""Measures what images of a frame sensor cost beside the events.

python -m bench.graph.frame_camera [--quick]
"""

from __future__ import annotations

import time
from typing import Any

import evis
from bench import command

SCENES = ("spinning_disk", "warehouse")
PRESETS = ("ideal", "davis346")


def row(scene: str, preset: str, repeats: int, steps: int) -> dict[str, Any]:
    """Measures steps with and without images in turn, and gives the least CPU time of either."""
    kinds = {"events": ["events"], "with images": ["events", "image"]}
    best = dict.fromkeys(kinds, float("inf"))
    sims = {name: evis.Simulation(scene, outputs=outputs, preset=preset, audit=0) for name, outputs in kinds.items()}
    for sim in sims.values():
        sim.run(0.1)
    for _ in range(repeats):
        for name, sim in sims.items():
            sim.reset()
            began = time.process_time()
            for _ in range(steps):
                sim.step()
            best[name] = min(best[name], (time.process_time() - began) / steps)
    for sim in sims.values():
        sim.close()
    line: dict[str, Any] = {"scene": scene, "sensor": preset}
    line |= {f"{name} [ms]": round(1e3 * seconds, 2) for name, seconds in best.items()}
    return line | {"times as long": round(best["with images"] / best["events"], 2)}


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures two scenes with an ideal sensor and a DAVIS346."""
    repeats, steps = (2, 5) if quick else (5, 15)
    scenes = SCENES[:1] if quick else SCENES
    return {
        "images": {
            "title": "A step with and without images, 346x260, 30 keyframes and images/s, K = 8",
            "command": "python -m bench.graph.frame_camera",
            "rows": [row(scene, preset, repeats, steps) for scene in scenes for preset in PRESETS],
            "note": f"CPU time of the process per step, the least of {repeats} runs that alternate.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
