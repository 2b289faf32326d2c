"""Measures what light costs: milliseconds of shading by kind of light, material and sky, and the noise of soft shadows.

python -m bench.renderer.light [--quick]
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from bench import command
from bench.renderer.scenes import balls
from evis.scene.model import Light, Material, Scene
from nodes.renderer.renderer import Renderer

COMMAND = "python -m bench.renderer.light"
SIZE = (346, 260)
POSITION = np.array([0.5, -1.5, 0.5])
LIGHTS = {
    "directional": Light("sun", "directional", np.ones(3), np.array([0.3, 0.5, 1.0])),
    "point": Light("bulb", "point", np.ones(3), POSITION),
    "spot": Light("spot", "spot", np.ones(3), POSITION, direction=np.array([-0.2, 0.6, 1.0]), cone=(0.5, 0.8)),
    "area": Light("lamp", "area", np.ones(3), POSITION, half_u=np.array([0.3, 0, 0]), half_v=np.array([0, 0.2, -0.2])),
}


def lit(kinds: tuple[str, ...], gloss: bool, mapped: bool, size: tuple[int, int] = SIZE) -> tuple[Scene, np.ndarray]:
    """Makes ten spheres before a wall under these kinds of light."""
    scene, poses = balls(10, 20, size)
    scene.lights = [LIGHTS[kind] for kind in kinds]
    roughness = 0.4 if gloss else 1.0
    scene.materials = [Material("surface", np.full(3, 0.5), roughness=roughness)]
    if mapped:
        scene.environment_map = np.random.default_rng(0).random((256, 512, 3)).astype(np.float32)
    return scene, poses


def shading(kinds: tuple[str, ...], gloss: bool, mapped: bool, repeats: int) -> dict[str, Any]:
    """Measures the CPU time of shading with every pixel lit anew, since all bodies count as moving."""
    from bench.renderer.stages import milliseconds

    scene, poses = lit(kinds, gloss, mapped)
    r = Renderer(scene, scene.cameras[0])
    r.prepare(["radiance"])
    frames = r.visibility.update(poses)
    r.shading.update(frames)
    target = wp.empty(r.shape, dtype=r.types["radiance"], device="cpu")
    return {
        "lights": ", ".join(kinds) or "none",
        "material": "GGX" if gloss else "diffuse",
        "sky": "map" if mapped else "uniform",
        "shading [ms]": round(milliseconds(lambda k: r.shading.shade(target), repeats), 1),
    }


def noise(samples: int) -> dict[str, Any]:
    """Measures the noise of a soft shadow: log radiance against that of 576 shadow rays, and between two images."""
    scene, poses = lit(("area",), False, False, (120, 90))
    images = []
    for count in (samples, 576):
        r = Renderer(scene, scene.cameras[0], light_samples=count)
        images.append(r.render(poses)["radiance"][0, ..., 0].copy())
        moved = poses.copy()
        moved[0, 0, 0] += 1e-9
        again = r.render(moved)["radiance"][0, ..., 0]
        if count == samples:
            still = (r.render(poses, None, ("ids",))["ids"][0] == 1) & (images[0] > 0) & (again > 0)
            flicker = np.log(again[still] / images[0][still]).std()
    partly = still & (images[1] > 0) & (np.abs(images[0] / np.maximum(images[1], 1e-9) - 1) > 1e-6)
    return {
        "shadow rays": samples,
        "in penumbrae, on the surface": round(float(np.log(images[0][partly] / images[1][partly]).std()), 4),
        "from image to image, still surface": float(flicker),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures both tables; quick: fewer repetitions."""
    repeats = 3 if quick else 15
    cases: list[tuple[tuple[str, ...], bool, bool]] = [((kind,), False, False) for kind in LIGHTS] + [
        (tuple(LIGHTS), False, False)
    ]
    cases += [(("directional",), True, False), (("area",), True, False), ((), False, True), ((), True, True)]
    return {
        "light": {
            "title": f"Shading by kind of light, {SIZE[0]} x {SIZE[1]}, one core",
            "command": COMMAND,
            "rows": [shading(*case, repeats) for case in cases],
            "note": "Medians of CPU time, with shadows, every pixel lit anew. An area light has 16 shadow rays where "
            "something may be in the way; its gloss 32 samples, a map's 24.",
        },
        "noise": {
            "title": "Standard deviation of log radiance under an area light",
            "command": COMMAND,
            "rows": [noise(samples) for samples in (4, 16, 64)],
            "note": "The random numbers belong to the surface: a still one looks the same in every image.",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
