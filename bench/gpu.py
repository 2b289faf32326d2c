"""What the pure parts cost on a CUDA device, arrays staying there: renderer, splat and event sensor.

`python -m bench.gpu [--quick]`. Wall milliseconds per call with the device idle before and after, medians; the host's
share (poses to matrices, launches) is in them.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from bench import disk
from bench.signals import SECOND
from evis.scene import load_scene
from nodes.event_sensor.sensor import EventSensor
from nodes.renderer.renderer import OUTPUTS, Renderer
from nodes.renderer.visibility import Visibility

DEVICE = "cuda:0"
STEP_NS = 4_000_000
"""Between two keyframes of a measurement: everything that can move does."""


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
            renderer.render(poses[i], poses[max(i - 1, 0)], OUTPUTS, out)

        row[label] = milliseconds(render, count)
    visibility = Visibility(scene, camera, envs, 0, DEVICE, 1)
    row["visibility [ms]"] = milliseconds(lambda i: visibility.update(poses[i]), count)
    return row


def sensor_row(k: int, count: int) -> dict[str, Any]:
    """Frames of the HDR disk, already on the device, K a call; events sorted but not read out."""
    t = (np.arange(k * (count + 3), dtype=np.int64) + 1) * (SECOND // 1000)
    frames = disk.record(t, soft=1.0).luminance
    sensor = EventSensor(480, 640, device=DEVICE)
    images = [wp.array(frames[i : i + k][None], dtype=wp.float32, device=DEVICE) for i in range(0, len(t), k)]
    events = 0

    def sense(i: int) -> None:
        nonlocal events
        events += sensor.advance(images[i], t[i * k : (i + 1) * k], np.zeros(1, np.int32))

    ms = milliseconds(sense, count)
    return {
        "frames a call": k,
        "ms a call": ms,
        "frames/s": round(1e3 * k / ms),
        "Mev/s": round(events / (count + 3) / ms / 1e3, 1),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Raises RuntimeError where there is no CUDA device."""
    wp.init()
    if not wp.is_cuda_available():
        raise RuntimeError("there is no CUDA device here; this subject measures nothing else")
    count = 10 if quick else 40
    name = wp.get_device(DEVICE).name
    sizes = [("warehouse", 1, (640, 480)), ("warehouse", 64, (128, 128)), ("spinning_disk", 1, (346, 260)),
             ("spinning_disk", 64, (128, 128)), ("spinning_disk", 1024, (128, 128)), ("drone", 1, (640, 480))]
    return {
        "renderer": {
            "title": f"Renderer on {name}, every image anew",
            "command": "python -m bench.gpu",
            "rows": [renderer_row(*row, count=count) for row in sizes],
            "note": "",
        },
        "sensor": {
            "title": f"Event sensor on {name}, HDR disk, 640x480 at 1 kHz",
            "command": "python -m bench.gpu",
            "rows": [sensor_row(k, count) for k in (1, 8, 50)],
            "note": "Plain model, sorting included, events stay on the device.",
        },
    }


if __name__ == "__main__":
    print(json.dumps(measure("--quick" in sys.argv), indent=1))
