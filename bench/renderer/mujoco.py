"""Renders the same scene with MuJoCo's own renderer (OpenGL; without a GPU, Mesa's software rasterizer)."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from evis.geometry import se3
from evis.scene.model import Mesh, Scene

HALF_TURN = se3.exp(np.array([np.pi, 0.0, 0.0]))
"""MuJoCo's cameras look along -z with y up."""


def drawing(scene: Scene, poses: np.ndarray, depth: bool) -> Callable[[], np.ndarray] | None:
    """Makes a function that moves the bodies to `poses` [N, 7] and draws colour or depth; None without OpenGL.

    The scene's first camera, point lights and plain materials are taken over.
    """
    earlier = "mujoco" in sys.modules
    os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import mujoco

        if earlier:
            # MuJoCo chose its OpenGL when it was imported, by physics perhaps, which draws nothing: it chooses anew.
            importlib.reload(sys.modules[mujoco.Renderer.__module__].gl_context)
        model = compiled(scene, poses)
        data = mujoco.MjData(model)
        camera = scene.cameras[0]
        renderer = mujoco.Renderer(model, camera.height, camera.width, max_geom=len(scene.instances) + 100)
    except (ImportError, AttributeError, RuntimeError, OSError):
        # What else imports MuJoCo shall not look for OpenGL again.
        os.environ["MUJOCO_GL"] = "disabled"
        return None
    if depth:
        renderer.enable_depth_rendering()
    image = np.empty((camera.height, camera.width), np.float32) if depth else None

    def draw() -> np.ndarray:
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        renderer.update_scene(data, camera=camera.name)
        return np.asarray(renderer.render(out=image))

    return draw


def compiled(scene: Scene, poses: np.ndarray) -> Any:
    """Compiles the scene at `poses` [N, 7] as a MuJoCo model. Raises ImportError without MuJoCo."""
    import mujoco

    spec = mujoco.MjSpec()
    # Thin things stay as they are: nothing is simulated.
    spec.compiler.balanceinertia = True
    _fill(mujoco, spec, scene, poses)
    return spec.compile()


def _fill(mujoco, spec, scene: Scene, poses: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    camera = scene.cameras[0]
    getattr(spec.visual, "global").offwidth = camera.width
    getattr(spec.visual, "global").offheight = camera.height
    names: dict[int, str] = {}
    for instance in scene.instances:
        if id(instance.mesh) not in names:
            names[id(instance.mesh)] = f"mesh{len(names)}"
            _add_mesh(mujoco, spec, names[id(instance.mesh)], instance.mesh)
    bodies = [_body(spec.worldbody, body.name, pose) for body, pose in zip(scene.bodies, poses)]
    for instance in scene.instances:
        colour = [float(v) for v in scene.materials[instance.material].albedo]
        parent = spec.worldbody if instance.body < 0 else bodies[instance.body]
        parent.add_geom(
            name=instance.name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=names[id(instance.mesh)],
            pos=instance.pose[:3], quat=instance.pose[[6, 3, 4, 5]], rgba=[*colour, 1.0], contype=0, conaffinity=0,
        )  # fmt: skip
    quaternion = HALF_TURN[[3, 0, 1, 2]]
    fov = np.degrees(2 * np.arctan(0.5 * camera.height / camera.k[1, 1]))
    bodies[scene.body_index(camera.name)].add_camera(name=camera.name, quat=quaternion, fovy=fov)
    for light in scene.lights:
        spec.worldbody.add_light(name=light.name, pos=light.vector, castshadow=light.shadows)


def _body(parent, name: str, pose: np.ndarray):  # type: ignore[no-untyped-def]
    return parent.add_body(name=name, pos=pose[:3], quat=pose[[6, 3, 4, 5]])


def _add_mesh(mujoco, spec, name: str, mesh: Mesh) -> None:  # type: ignore[no-untyped-def]
    added = spec.add_mesh(
        name=name, uservert=np.asarray(mesh.vertices, float).ravel(), userface=np.asarray(mesh.faces).ravel()
    )
    # A surface without volume has no inertia of a solid.
    added.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
