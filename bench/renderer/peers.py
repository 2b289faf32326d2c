"""Measures the renderer beside MuJoCo, MuJoCo Warp and Mitsuba 3, on the same scene and machine in one run.

    evis bench renderer_peers [--quick]
    python -m bench.renderer.peers --device cuda

A peer that is not installed is left out by name.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from bench import command
from bench.renderer import mitsuba, mujoco, mujoco_warp
from bench.renderer.scenes import hall, prescribed_poses
from evis.scene import load_scene
from evis.scene.model import Light, Scene
from nodes.renderer.paths.paths import PathOptions
from nodes.renderer.renderer import Renderer

COMMAND = "python -m bench.renderer.peers"
PATHS = 16
"""Paths for each pixel, ours and Mitsuba's."""

Contender = tuple[str, str, Callable[[], Any] | None]


def disk(size: tuple[int, int]) -> tuple[Scene, np.ndarray]:
    """Loads the spinning disk under a point light, and its poses at two instants, float64 [2, 1, N, 7]."""
    scene = load_scene("spinning_disk", dict(zip(("width", "height"), size)))
    for material in scene.materials:
        material.texture, material.roughness, material.metallic = None, 1.0, 0.0
        material.emission = np.zeros(3)
    scene.lights = [
        Light(l.name, l.kind, l.colour, l.vector) for l in scene.lights if l.kind in ("point", "directional")
    ]
    return scene, prescribed_poses(scene, np.array([0, 10**7]))


def ours(scene: Scene, poses: np.ndarray, image: str, device: str, paths: PathOptions | None) -> Callable[[], Any]:
    """Makes a function that draws one image, at each call at the other of two instants."""
    renderer = Renderer(scene, scene.cameras[0], device=device, paths=paths)
    out = {image: wp.empty(renderer.shape, dtype=renderer.types[image], device=device)}
    turn = [0]

    def draw() -> None:
        turn[0] = 1 - turn[0]
        renderer.render(poses[turn[0]], None, (image,), out)

    return draw


def contenders(scene: Scene, poses: np.ndarray, device: str) -> list[Contender]:
    """Lists the renderers that are compared: image, name, and the function that draws it, None where it is missing."""
    first = poses[0, 0]
    listed: list[Contender] = []
    for image in ("radiance", "depth"):
        listed += [
            (image, "EVIS", ours(scene, poses, image, device, None)),
            (image, "MuJoCo", mujoco.drawing(scene, first, image == "depth")),
            (image, "MuJoCo Warp", mujoco_warp.tracing(scene, first, image, device)),
        ]
    for depth, what in ((2, "radiance"), (3, f"one bounce, {PATHS} paths")):
        if depth == 3:
            listed.append((what, "EVIS", ours(scene, poses, "radiance", device, PathOptions(1, PATHS))))
        for name, variant in mitsuba.variants().items():
            samples = 1 if depth == 2 else PATHS
            listed.append((what, name, mitsuba.tracing(scene, first, depth, samples, variant)))
    return listed


def compare(label: str, scene: Scene, poses: np.ndarray, device: str, repeats: int) -> list[dict[str, Any]]:
    """Runs every renderer in turn, `repeats` times: the least time of each, and its ratio to ours."""
    listed = contenders(scene, poses, device)
    present = [(image, name, draw) for image, name, draw in listed if draw is not None]
    least = dict.fromkeys([(image, name) for image, name, _ in present], np.inf)
    for round_ in range(repeats + 1):
        for image, name, draw in present:
            spent = _milliseconds(draw, device)
            if round_ > 0:
                least[image, name] = min(least[image, name], spent)
    rows = []
    for image in dict.fromkeys(image for image, _, _ in listed):
        for name, spent in ((n, s) for (i, n), s in least.items() if i == image):
            rows.append(
                {
                    "scene": label,
                    "image": image,
                    "renderer": name,
                    "ms": round(spent, 2),
                    "times EVIS": round(spent / least[image, "EVIS"], 2),
                }
            )
    missing = sorted({name for _, name, draw in listed if draw is None})
    return rows + [{"scene": label, "renderer": name, "image": "left out: not installed"} for name in missing]


def _milliseconds(draw: Callable[[], Any], device: str) -> float:
    """CPU time of all threads; on a GPU the time that passes until it is done."""
    clock = time.process_time if device == "cpu" else time.perf_counter
    start = clock()
    draw()
    if device != "cpu":
        wp.synchronize_device(device)
    return 1e3 * (clock() - start)


def measure(quick: bool = False, device: str = "cpu") -> dict[str, Any]:
    """Measures the table; quick: a smaller image and fewer repetitions."""
    size, repeats = ((346, 260), 2) if quick else ((640, 480), 5)
    where = f"{size[0]} x {size[1]}"
    return {
        "peers": {
            "title": f"The same scenes by other renderers, {device}",
            "command": COMMAND,
            "rows": [
                *compare(f"spinning_disk {where}", *disk(size), device, repeats),
                *compare(f"hall {where}, moving camera", *hall(size, still_camera=False), device, repeats),
            ],
            "note": "Least of several times, the renderers in turn: CPU time of all threads, on a GPU the time that "
            "passes. EVIS: float32 linear radiance with ray-traced shadows, or depth; its bodies move between images. "
            "What stays still before a still camera it keeps. "
            "MuJoCo: 8-bit colour with shadow maps by OpenGL. MuJoCo Warp: 8-bit colour with ray-traced shadows. "
            f"Mitsuba: float32 radiance, 1 path for each pixel (direct light) or {PATHS}. The scenes have 0.2 "
            "million triangles (hall), plain materials and one or two lights; those of the others stand still.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "", device="cpu")
