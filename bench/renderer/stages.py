"""Measures milliseconds per keyframe and stage of the renderer on one CPU core, and the raster against rays.

evis bench renderer [--quick]
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from bench import command
from bench.renderer.ray_kernels import cast_rays, differing
from bench.renderer.scenes import balls, hall, prescribed_poses
from evis.scene import load_scene
from evis.scene.model import Scene
from nodes.interpolator.luminance import luminance_of
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import LIGHT, Renderer

COMMAND = "evis bench renderer"
SIZES = ((346, 260), (640, 480))
RATE = 30.0
"""Keyframes per second of the runs."""


def milliseconds(call: Callable[[int], Any], repeats: int) -> float:
    """Measures the median CPU time [ms] of `call(k)`, k = 1..repeats, after one to warm up."""
    call(0)
    times = []
    for k in range(1, repeats + 1):
        start = time.process_time()
        call(k)
        times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


def keyframe_times(count: int) -> np.ndarray:
    """Computes the stamps int64 [count] ns of keyframes from 0 on."""
    return np.rint(np.arange(count) * 1e9 / RATE).astype(np.int64)


def stages(name: str, size: tuple[int, int], shadows: bool, repeats: int) -> dict[str, Any]:
    """Measures a keyframe with depth and motion, stage by stage, of a scene of prescribed motion."""
    scene = load_scene(name, dict(zip(("width", "height"), size)))
    for light in scene.lights:
        light.shadows = light.shadows and shadows
    poses = list(prescribed_poses(scene, keyframe_times(repeats + 2)))
    return {
        "scene": f"{name} {size[0]} x {size[1]}, {'shadows' if shadows else 'no shadows'}",
        **stage_times(scene, poses, repeats),
    }


def stage_times(scene: Scene, poses: list[np.ndarray], repeats: int) -> dict[str, Any]:
    """Measures the stages of keyframes at poses [repeats + 2], each after the one before."""
    r = Renderer(scene, scene.cameras[0])
    v = r.visibility
    out = {name: np.empty(*r.array_shape(name)) for name in ("radiance", "depth", "motion")}
    targets = {name: wp.empty(r.shape, dtype=r.types[name], device="cpu") for name in out}

    def place(k: int) -> None:
        v.place(v.instance_poses(poses[k + 1]), poses[k])

    def geometric(k: int) -> None:
        place(k)
        r.displace(targets)
        r.geometric(targets)

    def shade(k: int) -> None:
        r.shading.update(v.update(poses[k]))
        r.shading.shade(targets["radiance"])

    placed = milliseconds(place, repeats)
    raster = milliseconds(lambda k: v.update(poses[k]), repeats)
    return {
        "triangles": len(v.geometry.triangles),
        "keyframe [ms]": round(milliseconds(lambda k: r.render(poses[k + 1], poses[k], out, out), repeats), 2),
        "poses [ms]": round(placed, 2),
        "raster [ms]": round(raster, 2),
        "depth and motion [ms]": round(milliseconds(geometric, repeats) - placed, 2),
        "shading [ms]": round(milliseconds(shade, repeats) - raster, 2),
        "nothing moves [ms]": round(milliseconds(lambda k: r.render(poses[0], poses[0], out, out), repeats), 2),
    }


def luminance_alone(name: str, size: tuple[int, int], repeats: int) -> dict[str, Any]:
    """Measures a keyframe of luminance, and one of radiance with the conversion to luminance; least times."""
    scene = load_scene(name, dict(zip(("width", "height"), size)))
    poses = prescribed_poses(scene, keyframe_times(repeats + 2))
    least, taken, image_bytes = dict.fromkeys(LIGHT, np.inf), np.inf, {}
    renderers = {kind: Renderer(scene, scene.cameras[0]) for kind in LIGHT}
    out = {kind: {kind: np.empty(*r.array_shape(kind))} for kind, r in renderers.items()}
    for k in range(repeats + 2):
        for kind, renderer in renderers.items():
            start = time.process_time()
            image = renderer.render(poses[k], None, (kind,), out[kind])[kind]
            drawn = time.process_time()
            luminance_of(image)
            end = time.process_time()
            image_bytes[kind] = image.nbytes
            # The first two load kernels, and draw what is kept from then on.
            if k > 1:
                least[kind] = min(least[kind], drawn - start)
                taken = min(taken, end - drawn) if kind == "radiance" else taken
    rgb, alone = 1e3 * (least["radiance"] + taken), 1e3 * least["luminance"]
    return {
        "scene": f"{name} {size[0]} x {size[1]}",
        "radiance [ms]": round(1e3 * least["radiance"], 2),
        "its luminance [ms]": round(1e3 * taken, 2),
        "luminance alone [ms]": round(alone, 2),
        "saved": f"{100 * (1 - alone / rgb):.1f}%",
        "radiance [kB]": image_bytes["radiance"] // 1000,
        "luminance [kB]": image_bytes["luminance"] // 1000,
    }


def background(label: str, scene: Scene, poses: list[np.ndarray], repeats: int) -> dict[str, Any]:
    """Measures visibility with the still background kept and drawn anew: times, their ratio, pixels that differ."""
    kept = Visibility(scene, scene.cameras[0])
    anew = Visibility(scene, scene.cameras[0], layered=False)
    frames = [kept.instance_poses(p) for p in poses]
    fast = milliseconds(lambda k: kept.update(frames[k % len(frames)]), repeats)
    slow = milliseconds(lambda k: anew.update(frames[k % len(frames)]), repeats)
    return {
        "scene": f"{label}, {len(kept.geometry.triangles)} triangles",
        "still instances": f"{int(kept.geometry.static.sum())} of {len(scene.instances)}",
        "kept [ms]": round(fast, 2),
        "drawn anew [ms]": round(slow, 2),
        "drawn anew / kept": round(slow / fast, 1),
        "pixels that differ": int((kept.packed.numpy() != anew.packed.numpy()).sum()),
    }


def backgrounds(size: tuple[int, int], repeats: int) -> list[dict[str, Any]]:
    """Measures a kept background on the spinning disk and on the hall."""
    disk = load_scene("spinning_disk", dict(zip(("width", "height"), size)))
    instants = list(prescribed_poses(disk, np.array([0, 10**7])))
    crowd, poses = hall(size)
    return [
        background(f"spinning_disk {size[0]} x {size[1]}", disk, instants, repeats),
        background(f"hall {size[0]} x {size[1]}", crowd, list(poses), repeats),
    ]


def raster_against_rays(size: tuple[int, int], rings: int, repeats: int) -> dict[str, Any]:
    """Measures the visibility of ten balls by raster and by rays: times, ratio, pixels that do not agree."""
    scene, poses = balls(10, rings, size)
    v = Visibility(scene, scene.cameras[0])
    raster = milliseconds(lambda k: v.update(poses), repeats)
    geometry, frames = v.geometry, v.instance_poses(poses)
    turn, place = frames.rotation[0, geometry.vertex_instance], frames.translation[0, geometry.vertex_instance]
    vertices: wp.array = wp.array((turn @ geometry.vertices[..., None])[..., 0] + place, dtype=wp.vec3)
    mesh = wp.Mesh(wp.clone(vertices), wp.array(geometry.triangles.reshape(-1), dtype=wp.int32), bvh_constructor="sah")
    triangle, depth = wp.empty(v.shape, dtype=wp.int32), wp.empty(v.shape, dtype=wp.float32)

    def rays(k: int) -> None:
        wp.copy(mesh.points, vertices)
        mesh.refit()
        wp.launch(cast_rays, dim=v.shape, inputs=[v.view, mesh.id, triangle, depth])

    traced = milliseconds(rays, repeats)
    count = wp.zeros(1, dtype=wp.int32)
    wp.launch(differing, dim=v.shape, inputs=[v.packed, triangle, depth, count])
    return {
        "visibility": f"{size[0]} x {size[1]}, {len(v.geometry.triangles)} triangles",
        "raster [ms]": round(raster, 2),
        "rays [ms]": round(traced, 2),
        "rays / raster": round(traced / raster, 1),
        "pixels that differ": int(count.numpy()[0]),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all tables; quick: fewer repetitions."""
    repeats = 5 if quick else 30
    few = 3 if quick else 8
    return {
        "stages": {
            "title": "Renderer: a keyframe with depth and motion, one core",
            "command": COMMAND,
            "rows": [
                *(stages("spinning_disk", size, shadows, repeats) for size in SIZES for shadows in (True, False)),
                *(stages("warehouse", SIZES[1], shadows, few) for shadows in (True, False)),
            ],
            "note": "Medians of CPU time. Light on still surfaces is remembered while the camera is still, so the "
            "disk's `shading` is what it and its shadow change; the camera of the warehouse moves, and every pixel "
            "looks for each of its lights anew. `nothing moves` copies the last images.",
        },
        "background": {
            "title": "A still background kept, against drawn anew, one core",
            "command": COMMAND,
            "rows": backgrounds(SIZES[1], repeats),
            "note": "Visibility alone (z-buffer and triangle of each pixel). The result is the same, bit for bit.",
        },
        "visibility": {
            "title": "Visibility by raster against primary rays, one core",
            "command": COMMAND,
            "rows": [raster_against_rays(size, rings, repeats) for size in SIZES for rings in (8, 35)],
            "note": "Rays: a world-space SAH tree, refitted to the moved vertices each time. A pixel differs where "
            "one way sees nothing or the depths are more than 1e-4 apart: its centre lies on a silhouette, "
            "within float32.",
        },
        "luminance": {
            "title": "Renderer: keyframes of luminance, where nobody reads colour, one core",
            "command": COMMAND,
            "rows": [
                luminance_alone(name, size, 2 * few)
                for name, size in (("spinning_disk", SIZES[0]), ("drone", SIZES[1]), ("warehouse", SIZES[1]))
            ],
            "note": "Least CPU times of both in turn. Albedo and light are multiplied channel by channel, so shading "
            "takes three in any case; what is saved is writing them, reading them again, and their way between.",
        },
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
