"""Measures path tracing: milliseconds by bounces and paths, and noise from image to image as the camera stays or moves.

evis bench renderer_paths [--quick]
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bench import command
from bench.renderer.scenes import prescribed_poses
from evis.geometry import se3
from evis.media.colour import REC709
from evis.scene import load_scene
from evis.scene.model import Scene
from nodes.renderer.paths.paths import PathOptions
from nodes.renderer.renderer import Renderer

COMMAND = "evis bench renderer_paths"
THRESHOLD = 0.2
"""Contrast threshold of the sensor that the noise is judged by."""
EDGE = 0.02
"""Change of the log of direct light from which on there is a shadow's edge."""


def room(size: tuple[int, int], plain: bool = True) -> tuple[Scene, np.ndarray]:
    """Loads a furnished room at rest and its poses; plain: without textures, so that only light varies on a surface."""
    scene = load_scene("stereo_room", dict(zip(("width", "height"), size)))
    if plain:
        for material in scene.materials:
            material.texture, material.roughness, material.metallic = None, 1.0, 0.0
    return scene, prescribed_poses(scene, np.array([0]))[0]


def moved(scene: Scene, poses: np.ndarray, pixels: float) -> np.ndarray:
    """Computes poses with the camera turned by about `pixels`, and shifted by a tenth of what that is at 1 m."""
    camera = scene.cameras[0]
    index, angle = scene.body_index(camera.name), pixels / float(camera.k[0, 0])
    out = poses.copy()
    step = se3.make_pose(np.array([0.1 * angle, 0.05 * angle, 0.0]), se3.exp(np.array([0.3 * angle, angle, 0.0])))
    out[0, index] = se3.compose(poses[0, index], step)
    return out


def followed(now: dict[str, np.ndarray], before: dict[str, np.ndarray]) -> np.ndarray:
    """Computes the change of log luminance [N] of each surface point since the image before, where both saw it.

    The image before is interpolated at the point's place in it, between four pixels of the same surface.
    """
    motion, normal = now["motion"][0].astype(np.float64), now["normal"][0]
    height, width = motion.shape[:2]
    y, x = np.mgrid[:height, :width]
    px, py = x + motion[..., 0], y + motion[..., 1]
    inside = (px >= 0) & (py >= 0) & (px < width - 1) & (py < height - 1)
    y, x, px, py = y[inside], x[inside], px[inside], py[inside]
    i, j = px.astype(int), py.astype(int)
    same = np.ones(len(i), bool)
    level, total = np.log(luminance(before)), np.zeros(len(i))
    for dj in (0, 1):
        for di in (0, 1):
            same &= before["ids"][0, j + dj, i + di] == now["ids"][0, y, x]
            same &= (before["normal"][0, j + dj, i + di] * normal[y, x]).sum(-1) > 0.999
            total += np.where(di, px - i, 1 - px + i) * np.where(dj, py - j, 1 - py + j) * level[j + dj, i + di]
    same &= now["ids"][0, y, x] > 0
    return (np.log(luminance(now))[y, x] - total)[same]


def luminance(images: dict[str, np.ndarray]) -> np.ndarray:
    """Computes luminance [H, W] in float64, at least 1e-6."""
    return np.maximum(images["radiance"][0].astype(np.float64) @ REC709, 1e-6)


def changes(options: PathOptions | None, pixels: float, size: tuple[int, int]) -> np.ndarray:
    """Computes `followed` between two images of the room, the second with the camera moved."""
    scene, poses = room(size)
    renderer = Renderer(scene, scene.cameras[0], paths=options)
    wanted = ("radiance", "motion", "ids", "normal")
    other = moved(scene, poses, max(pixels, 1.0))
    before = {k: v.copy() for k, v in renderer.render(poses, None, wanted).items()}
    if pixels == 0:
        # Something else in between, so that the image is computed anew.
        renderer.render(other, None, wanted)
        other = poses
    return followed(renderer.render(other, poses, wanted), before)


def stillness(options: PathOptions, pixels: float, size: tuple[int, int]) -> dict[str, Any]:
    """Measures the standard deviation of the change of log luminance between two images, following the surface.

    Only where direct light, which has no noise, changes by less than EDGE: between the pixels of a shadow's edge
    interpolation gives something else.
    """
    change, direct = changes(options, pixels, size), changes(None, pixels, size)
    level = np.abs(direct) < EDGE
    return {
        "light": f"{options.bounces} bounces, {options.samples} paths",
        "camera moves [px]": pixels,
        "deviation of log luminance": round(float(change[level].std()), 4),
        "of C = 0.2": f"{float(change[level].std()) / THRESHOLD:.1%}",
        "beyond C": f"{float((np.abs(change[level]) > THRESHOLD).mean()):.2%}",
        "direct light": round(float(direct[level].std()), 4),
        "pixels judged": f"{float(level.mean()):.1%}",
    }


def cost(name: str, options: PathOptions | None, size: tuple[int, int], repeats: int) -> dict[str, Any]:
    """Measures the CPU time of an image of a scene, every pixel lit anew."""
    from bench.renderer.stages import milliseconds

    scene = load_scene(name, dict(zip(("width", "height"), size)))
    poses = prescribed_poses(scene, np.array([0]))[0]
    pair = [moved(scene, poses, 1.0), poses]
    renderer = Renderer(scene, scene.cameras[0], paths=options)
    spent = milliseconds(lambda k: renderer.render(pair[k % 2], None, ("radiance",)), repeats)
    return {
        "scene": f"{name} {size[0]} x {size[1]}",
        "light": "direct" if options is None else f"{options.bounces} bounces, {options.samples} paths",
        "image [ms]": round(spent, 1),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures both tables; quick: smaller images and fewer repetitions."""
    size, repeats = ((173, 130), 1) if quick else ((346, 260), 3)
    options: list[PathOptions | None] = [None, PathOptions(0, 16), PathOptions(1, 16), PathOptions(2, 16)]
    moves = [(PathOptions(1), p) for p in (0.0, 0.5, 2.3, 10.7)] + [(PathOptions(1, 64), 2.3)]
    return {
        "paths": {
            "title": "Path tracing: an image with a camera that moves, one core",
            "command": COMMAND,
            "rows": [cost(n, o, size, repeats) for n in ("spinning_disk", "stereo_room") for o in options],
            "note": "Medians of CPU time. 0 bounces: light of the sky and of glowing surfaces with occlusion.",
        },
        "stillness": {
            "title": "Path tracing: change of log luminance from image to image, following the surface",
            "command": COMMAND,
            "rows": [stillness(o, p, size) for o, p in moves],
            "note": "A room at rest, without textures, 16 paths being the default. Judged where direct light, which "
            f"has no noise, changes by less than {EDGE}: not at the edges of hard shadows.",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
