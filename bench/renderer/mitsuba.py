"""Renders the same scene with Mitsuba 3, a physically based path tracer (`pip install mitsuba`)."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np

from evis.geometry import se3
from evis.scene.model import Light, Scene

LLVM = "DRJIT_LIBLLVM_PATH"
"""Where this environment variable names an LLVM library, later than 16, Mitsuba's compiling variant runs too."""


def variants() -> dict[str, str]:
    """Lists Mitsuba's variants that are compared, by the name in the table."""
    return {"Mitsuba": "scalar_rgb"} | ({"Mitsuba llvm": "llvm_ad_rgb"} if os.environ.get(LLVM) else {})


def tracing(scene: Scene, poses: np.ndarray, depth: int, samples: int, variant: str) -> Callable[[], np.ndarray] | None:
    """Makes a function that traces the scene at `poses` [N, 7]; None where Mitsuba is not installed.

    depth: Mitsuba's max_depth, 2 for direct light. The scene's first camera, its lights without cones and its plain
    diffuse materials are taken over; the scene is built once, and only tracing is left for the function.
    """
    try:
        import mitsuba as mi
    except ImportError:
        return None
    mi.set_variant(variant)
    built: Any = mi.load_dict(_description(mi, scene, poses, depth))

    def draw() -> np.ndarray:
        mi.set_variant(variant)
        return np.array(mi.render(built, spp=samples))

    return draw


def _description(mi: Any, scene: Scene, poses: np.ndarray, depth: int) -> dict[str, Any]:
    camera = scene.cameras[0]
    eye = poses[scene.body_index(camera.name)]
    to_world = np.eye(4)
    # Mitsuba's cameras look along +z with x to the left and y up.
    to_world[:3, :3], to_world[:3, 3] = se3.to_matrix(eye[3:]) @ np.diag([-1.0, -1.0, 1.0]), eye[:3]
    made: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth},
        "sensor": {
            "type": "perspective",
            "fov_axis": "y",
            "fov": float(np.degrees(2 * np.arctan(0.5 * camera.height / camera.k[1, 1]))),
            "to_world": mi.ScalarTransform4f(to_world),
            "sampler": {"type": "independent"},
            "film": {
                "type": "hdrfilm",
                "width": camera.width,
                "height": camera.height,
                "pixel_format": "rgb",
                "rfilter": {"type": "box"},
            },
        },
        "sky": {"type": "constant", "radiance": _rgb(scene.environment)},
    }
    for index, light in enumerate(scene.lights):
        made[f"light{index}"] = _light(mi, light)
    for index in range(len(scene.materials)):
        mesh = _mesh(mi, scene, poses, index)
        if mesh is not None:
            made[f"mesh{index}"] = mesh
    return made


def _light(mi: Any, light: Light) -> dict[str, Any]:
    place = [float(v) for v in light.vector]
    if light.kind == "directional":
        return {"type": "directional", "direction": place, "irradiance": _rgb(light.colour)}
    return {"type": "point", "position": place, "intensity": _rgb(light.colour)}


def _rgb(colour: np.ndarray) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(v) for v in colour]}


def _mesh(mi: Any, scene: Scene, poses: np.ndarray, material: int) -> Any:
    """All triangles of a material in the world's frame; None where it has none."""
    vertices, faces, base = [], [], 0
    for instance in scene.instances:
        if instance.material != material or not len(instance.mesh.faces):
            continue
        pose = instance.pose if instance.body < 0 else se3.compose(poses[instance.body], instance.pose)
        vertices.append(instance.mesh.vertices @ se3.to_matrix(pose[3:]).T + pose[:3])
        faces.append(np.asarray(instance.mesh.faces) + base)
        base += len(instance.mesh.vertices)
    if not faces:
        return None
    properties = mi.Properties()
    plain = {"type": "diffuse", "reflectance": _rgb(np.clip(scene.materials[material].albedo, 0, 1))}
    properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": plain})
    points, corners = np.concatenate(vertices), np.concatenate(faces)
    mesh = mi.Mesh(f"mesh{material}", len(points), len(corners), properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = points.astype(np.float32).ravel()
    parameters["faces"] = corners.astype(np.uint32).ravel()
    parameters.update()
    return mesh
