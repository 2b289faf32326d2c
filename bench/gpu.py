"""What the pure parts cost on a CUDA device, arrays staying there: renderer, splat and event sensor.

`python -m bench.gpu [--quick] [--only sensor] [--out FILE]`. Of the renderer, wall milliseconds per call with the
device idle before and after, medians; the host's share (poses to matrices, launches) is in them. The event sensor's
tables are explained in bench/event_sensor_gpu.py.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from bench import event_sensor_gpu
from evis.scene import load_scene
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import GEOMETRIC, LAST, Renderer

DEVICE = "cuda:0"
OUTPUTS = ("radiance", *GEOMETRIC)
STEP_NS = 4_000_000
"""Between two keyframes of a measurement: everything that can move does."""
RENDERED = (
    ("warehouse", 1, (640, 480)),
    ("warehouse", 64, (128, 128)),
    ("spinning_disk", 1, (346, 260)),
    ("spinning_disk", 64, (128, 128)),
    ("spinning_disk", 1024, (128, 128)),
    ("drone", 1, (640, 480)),
)
"""Scene, environments, size."""


def milliseconds(call: Callable[[int], object], count: int) -> float:
    """Median wall time of call(i) in ms, the device synchronised around each."""
    times = []
    for i in range(count + 3):
        wp.synchronize_device(DEVICE)
        start = time.perf_counter()
        call(i)
        wp.synchronize_device(DEVICE)
        times.append(1e3 * (time.perf_counter() - start))
    return round(statistics.median(times[3:]), 3)


def poses_of(scene: Any, count: int, envs: int) -> np.ndarray:
    """Poses [count, E, N, 7] of a scene with prescribed motion, STEP_NS apart."""
    t = np.arange(count, dtype=np.int64) * STEP_NS
    one = np.stack([b.trajectory.pose(t) for b in scene.bodies], axis=1)
    return np.repeat(one[:, None], envs, axis=1)


def renderer_row(name: str, envs: int, size: tuple[int, int], count: int) -> dict[str, Any]:
    """All outputs, the same without shadow rays, and visibility alone."""
    scene = load_scene(name, {"width": size[0], "height": size[1]})
    poses = poses_of(scene, count + 4, envs)
    camera = scene.cameras[0]
    row: dict[str, Any] = {"scene": name, "environments": envs, "size": f"{size[0]}x{size[1]}"}
    for label, shadows in (("all outputs, shadows [ms]", True), ("no shadow rays [ms]", False)):
        for light in scene.lights:
            light.shadows = light.shadows and shadows
        renderer = Renderer(scene, camera, envs, device=DEVICE)
        out = {n: wp.empty(renderer.shape, dtype=renderer.types[n], device=DEVICE) for n in OUTPUTS}

        def render(i: int, renderer: Renderer = renderer, out: dict[str, Any] = out) -> None:
            renderer.render(poses[i], LAST, OUTPUTS, out)

        row[label] = milliseconds(render, count)
    visibility = Visibility(scene, camera, envs, 0, DEVICE, 1)
    row["visibility [ms]"] = milliseconds(lambda i: visibility.update(poses[i]), count)
    return row


def measure(quick: bool = False, only: str = "") -> dict[str, Any]:
    """Tables whose names begin with `only`. Raises RuntimeError where there is no CUDA device."""
    wp.init()
    if not wp.is_cuda_available():
        raise RuntimeError("there is no CUDA device here; this subject measures nothing else")
    tables: dict[str, Any] = {}
    if "renderer".startswith(only):
        tables["renderer"] = {
            "title": f"Renderer on {wp.get_device(DEVICE).name}, every image anew",
            "rows": [renderer_row(*row, count=10 if quick else 40) for row in RENDERED],
            "note": "",
        }
    tables |= event_sensor_gpu.measure(quick, only)
    return {name: table | {"command": "python -m bench.gpu"} for name, table in tables.items()}


def text(table: dict[str, Any]) -> str:
    """A table for a terminal."""
    rows = [list(table["rows"][0]), *([str(v) for v in row.values()] for row in table["rows"])]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths)) for row in rows]
    return "\n".join([table["title"], *lines, table["note"], ""])


def main() -> None:
    """Print the tables; write them as JSON where --out says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--only", default="", help="what the wanted tables' names begin with, for example sensor")
    parser.add_argument("--out", type=Path, help="JSON file to write")
    args = parser.parse_args()
    tables = measure(args.quick, args.only)
    print("\n".join(text(table) for table in tables.values()))
    if args.out:
        args.out.write_text(json.dumps(tables, indent=1))


if __name__ == "__main__":
    main()
