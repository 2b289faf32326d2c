"""Milliseconds per keyframe and stage of the renderer on one CPU core, and visibility by raster against by rays.

`python -m bench.renderer [--quick]`
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import pinhole, se3
from evis.scene import load_scene
from evis.scene.model import Body, Camera, Instance, Material, Mesh, Scene
from nodes.renderer.kernels import MISS, View, depth_of, pixel_ray, triangle_of
from nodes.renderer.renderer import Renderer
from nodes.renderer.visibility import Visibility

COMMAND = "python -m bench.renderer"
SIZES = ((346, 260), (640, 480))
RATE = 30.0
"""Keyframes per second of the runs."""


@wp.kernel(enable_backward=False)
def cast_rays(
    # in
    view: View,
    mesh: wp.uint64,
    # out
    triangle: wp.array3d(dtype=int),
    depth: wp.array3d(dtype=float),
):
    """One primary ray per pixel from the camera, at the origin."""
    env, y, x = wp.tid()
    query = wp.mesh_query_ray(mesh, wp.vec3(0.0, 0.0, 0.0), pixel_ray(view, x, y), 1.0e6)
    triangle[env, y, x] = wp.where(query.result, query.face, MISS)
    depth[env, y, x] = query.t


@wp.kernel(enable_backward=False)
def differing(
    # in
    packed: wp.array3d(dtype=wp.uint64),
    triangle: wp.array3d(dtype=int),
    depth: wp.array3d(dtype=float),
    # out
    count: wp.array(dtype=int),
):
    """Pixels where one way sees something and the other nothing, or the depths are more than 1e-4 apart."""
    env, y, x = wp.tid()
    hit = packed[env, y, x]
    if (triangle_of(hit) == MISS) != (triangle[env, y, x] == MISS):
        wp.atomic_add(count, 0, 1)
    elif triangle_of(hit) != MISS and wp.abs(depth_of(hit) / depth[env, y, x] - 1.0) > 1.0e-4:
        wp.atomic_add(count, 0, 1)


def milliseconds(call: Callable[[int], Any], repeats: int) -> float:
    """Median CPU time of `call(k)`, k = 1..repeats, after one to warm up."""
    call(0)
    times = []
    for k in range(1, repeats + 1):
        start = time.process_time()
        call(k)
        times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


def stages(size: tuple[int, int], shadows: bool, repeats: int) -> dict[str, Any]:
    """spinning_disk: what a keyframe with depth and motion costs, stage by stage."""
    scene = load_scene("spinning_disk", dict(zip(("width", "height"), size)))
    for light in scene.lights:
        light.shadows = shadows
    times = [round(k * 1e9 / RATE) for k in range(repeats + 2)]
    poses = [np.array([[b.trajectory.pose(np.array([t]))[0] for b in scene.bodies]]) for t in times]
    r = Renderer(scene, scene.cameras[0])
    v = r.visibility
    frames = [v.frames(p) for p in poses]
    out = {name: np.empty(*r.array_shape(name)) for name in ("radiance", "depth", "motion")}
    targets = {name: wp.empty(r.shape, dtype=r.types[name], device="cpu") for name in out}

    def shade(k: int) -> None:
        v.update(frames[k])
        r.shading.update(frames[k])
        r.shading.shade(targets["radiance"])

    raster = milliseconds(lambda k: v.update(frames[k]), repeats)
    geometric = milliseconds(lambda k: r.geometric(frames[k + 1], frames[k], targets), repeats)
    return {
        "spinning_disk": f"{size[0]} x {size[1]}, {'shadows' if shadows else 'no shadows'}",
        "keyframe [ms]": round(milliseconds(lambda k: r.render(poses[k + 1], poses[k], out, out), repeats), 2),
        "matrices [ms]": round(milliseconds(lambda k: v.frames(poses[k]), repeats), 2),
        "raster [ms]": round(raster, 2),
        "depth and motion [ms]": round(geometric, 2),
        "shading [ms]": round(milliseconds(shade, repeats) - raster, 2),
        "nothing moves [ms]": round(milliseconds(lambda k: r.render(poses[0], poses[0], out, out), repeats), 2),
    }


def balls(count: int, rings: int, size: tuple[int, int]) -> tuple[Scene, np.ndarray]:
    """Spheres before a wall of two triangles, and their poses."""
    theta = np.linspace(0, np.pi, rings + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)[None]
    unit = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi], -1)
    i, j = np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij")
    a, b = i * 2 * rings + j, i * 2 * rings + (j + 1) % (2 * rings)
    c, d = a + 2 * rings, b + 2 * rings
    faces = np.concatenate([np.stack([a, c, b], -1)[1:], np.stack([b, c, d], -1)[:-1]])
    ball = Mesh((0.3 * unit).reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.int32))
    # The diagonal must not run through pixel centres, where both of its triangles are right.
    corners = np.array([(-9, -8, 4), (9, -9, 4), (8, 9.1, 4), (-9, 9, 4)], np.float32)
    wall = Mesh(corners, np.array([(0, 2, 1), (0, 3, 2)], np.int32))
    bodies = [Body(f"ball{k}", None) for k in range(count)] + [Body("cam0", None)]
    instances = [Instance("wall", -1, wall, 0)] + [Instance(f"ball{k}", k, ball, 0) for k in range(count)]
    camera = Camera("cam0", *size, pinhole.intrinsics(*size, 0.9 * size[0]))
    scene = Scene("balls", bodies, instances, [Material("grey", np.ones(3))], [], [camera], np.zeros(3))
    rng = np.random.default_rng(0)
    place = np.stack([*rng.uniform(-0.9, 0.9, (2, count)), rng.uniform(2, 3, count)], -1)
    poses = se3.make_pose(np.concatenate([place, np.zeros((1, 3))]), np.array([0, 0, 0, 1.0]))
    return scene, poses[None]


def raster_against_rays(size: tuple[int, int], rings: int, repeats: int) -> dict[str, Any]:
    """Visibility of ten balls both ways: times, their ratio, and the pixels that do not agree."""
    scene, poses = balls(10, rings, size)
    v = Visibility(scene, scene.cameras[0])
    raster = milliseconds(lambda k: v.update(poses), repeats)
    faces = wp.array(v.geometry.triangles.reshape(-1), dtype=wp.int32)
    mesh = wp.Mesh(wp.clone(v.vertices[0]), faces, bvh_constructor="sah")
    triangle, depth = wp.empty(v.shape, dtype=wp.int32), wp.empty(v.shape, dtype=wp.float32)

    def rays(k: int) -> None:
        wp.copy(mesh.points, v.vertices[0])
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
    """Both tables; quick: fewer repetitions."""
    repeats = 5 if quick else 30
    return {
        "stages": {
            "title": "Renderer: a keyframe with depth and motion, one core",
            "command": COMMAND,
            "rows": [stages(size, shadows, repeats) for size in SIZES for shadows in (True, False)],
            "note": "Medians of CPU time. Light on still surfaces is remembered, so `shading` is what the moving "
            "disk and its shadow change; `nothing moves` copies the last images.",
        },
        "visibility": {
            "title": "Visibility by raster against primary rays, one core",
            "command": COMMAND,
            "rows": [raster_against_rays(size, rings, repeats) for size in SIZES for rings in (8, 35)],
            "note": "Rays: a world-space SAH tree, refitted to the moved vertices each time. A pixel differs where "
            "one way sees nothing or the depths are more than 1e-4 apart: its centre lies on a silhouette, "
            "within float32.",
        },
    }


if __name__ == "__main__":
    for section in measure("--quick" in sys.argv[1:]).values():
        print(section["title"])
        for row in section["rows"]:
            print(" ", json.dumps(row))
