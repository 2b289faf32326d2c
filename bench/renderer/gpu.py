"""Measures the renderer on a CUDA device stage by stage: the host's milliseconds, the device's, and every kernel's.

`python -m bench.renderer.gpu [--quick]`. Images stay on the device. Everything that can move does from one call to the
next, so nothing is copied from the last image.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import warp as wp

from bench import command
from bench.renderer.scenes import prescribed_poses
from evis.scene import load_scene
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import GEOMETRIC, LAST, Renderer

COMMAND = "python -m bench.renderer.gpu"
OUTPUTS = ("radiance", *GEOMETRIC)
STEP_NS = 4_000_000
"""Between two keyframes."""

CASES = (
    ("warehouse", 1, (640, 480)),
    ("warehouse", 64, (128, 128)),
    ("spinning_disk", 1, (346, 260)),
    ("spinning_disk", 64, (128, 128)),
    ("spinning_disk", 1024, (128, 128)),
    ("drone", 1, (640, 480)),
)
"""Scene, environments, size."""


def timed(call: Callable[[int], object], count: int, device: str) -> dict[str, float]:
    """Measures milliseconds of call(i): until it returns, until the device is done, by the device's clock; medians.

    each: of calls one after another, with no wait between them.
    """
    host, wall, on_device = [], [], []
    begin, end = (wp.Event(device, enable_timing=True) for _ in range(2))
    stream = wp.get_stream(device)
    for i in range(count + 4):
        wp.synchronize_device(device)
        start = time.perf_counter()
        stream.record_event(begin)
        call(i)
        stream.record_event(end)
        host.append(1e3 * (time.perf_counter() - start))
        wp.synchronize_device(device)
        wall.append(1e3 * (time.perf_counter() - start))
        on_device.append(wp.get_event_elapsed_time(begin, end))
    start = time.perf_counter()
    for i in range(4, count + 4):
        call(i)
    wp.synchronize_device(device)
    each = 1e3 * (time.perf_counter() - start) / count
    # The first calls load kernels and record graphs.
    medians = {
        k: round(statistics.median(v[4:]), 3) for k, v in (("host", host), ("wall", wall), ("device", on_device))
    }
    return {**medians, "each": round(each, 3)}


def kernels(launch: Callable[[], object], count: int) -> dict[str, float]:
    """Measures device milliseconds of every kernel, copy and fill that `launch` starts, medians."""
    seen: dict[str, list[float]] = {}
    for _ in range(count):
        wp.timing_begin(cuda_filter=wp.TIMING_ALL)
        launch()
        one: dict[str, float] = {}
        for result in wp.timing_end():
            name = result.name.removeprefix("forward kernel ")
            one[name] = one.get(name, 0.0) + result.elapsed
        for name, elapsed in one.items():
            seen.setdefault(name, []).append(elapsed)
    return {name: round(statistics.median(values), 4) for name, values in seen.items()}


def rows_of(name: str, envs: int, size: tuple[int, int], count: int, device: str) -> Iterable[dict[str, Any]]:
    """Measures visibility alone, and all outputs with the shadows of all lights, of one light and of none."""
    scene = load_scene(name, {"width": size[0], "height": size[1]})
    times = np.arange(count + 5, dtype=np.int64) * STEP_NS
    poses = np.repeat(prescribed_poses(scene, times), envs, axis=1)
    case = f"{envs} x {name} {size[0]}x{size[1]}"
    visibility = Visibility(scene, scene.cameras[0], envs, 0, device)
    row = {"case": case, "what": "visibility", **timed(lambda i: visibility.update(poses[i]), count, device)}
    yield {**row, "kernels": kernels(visibility.draw, count)}

    def send(i: int) -> None:
        visibility.advance(poses[i], True)
        visibility.settle()

    yield {"case": case, "what": "poses checked and sent", **timed(send, count, device)}
    casting = [light for light in scene.lights if light.shadows]
    for rays in dict.fromkeys((len(casting), min(len(casting), 1), 0)):
        for light in casting[rays:]:
            light.shadows = False
        what = f"all outputs, shadows of {rays} light{'s' * (rays != 1)}" if rays else "all outputs, no shadows"
        renderer = Renderer(scene, scene.cameras[0], envs, device=device)
        out = {n: wp.empty(renderer.shape, dtype=renderer.types[n], device=device) for n in OUTPUTS}

        def render(i: int, renderer: Renderer = renderer, out: dict[str, Any] = out) -> None:
            renderer.render(poses[i], LAST, OUTPUTS, out)

        def launch(renderer: Renderer = renderer, out: dict[str, Any] = out) -> None:
            renderer.displace(out)
            renderer.geometric(out)
            renderer.shading.shade(out["radiance"])

        yield {"case": case, "what": what, **timed(render, count, device), "kernels": kernels(launch, count)}


def measure(quick: bool = False, device: str = "cuda") -> dict[str, Any]:
    """Measures every case on a CUDA device."""
    count = 10 if quick else 40
    return {
        "stages": {
            "title": f"Renderer on {wp.get_device(device).name}, milliseconds a call",
            "command": COMMAND,
            "rows": [row for case in CASES for row in rows_of(*case, count=count, device=device)],
            "note": "host: until the call returns, the device idle before. wall: until the images are there. device: "
            "from the first to the last thing that the device does. each: calls one after another, waited for at the "
            "end. kernels: of one image, launched one by one.",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "", device="cuda")
