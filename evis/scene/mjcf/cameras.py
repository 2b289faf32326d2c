"""Cameras of a MuJoCo model."""

from __future__ import annotations

import re
from typing import Any

import mujoco
import numpy as np

from evis.geometry import pinhole, se3
from evis.scene.mjcf.frames import MODE, TARGETS, free_name, name_of, rigid_frame, stays
from evis.scene.model import Body, Camera, Scene
from evis.scene.motion import Prescribed

FLIP = np.array([1.0, 0.0, 0.0, 0.0])
"""MuJoCo's cameras look along -z with y up: half a turn about x."""


def add_cameras(scene: Scene, model: Any, data: Any, size: tuple[int, int]) -> None:
    """Adds all cameras that can be simulated, each with a body, and a note of each of the others. size: width and
    height [px].
    """
    for i in range(model.ncam):
        name = name_of(model, mujoco.mjtObj.mjOBJ_CAMERA, i, "camera")
        if model.cam_projection[i] != mujoco.mjtProjection.mjPROJ_PERSPECTIVE:
            scene.notes.append(f"camera '{name}' is left out: it is orthographic")
            continue
        # It is part of the names of topics; MuJoCo's own tools put a / into those of attached models.
        name = free_name(scene, re.sub(r"[^\w.-]", "_", name), "camera")
        scene.bodies.append(_frame(scene, model, data, i, name))
        scene.cameras.append(Camera(name, *size, _intrinsics(model, i, size)))


def add_default(scene: Scene, model: Any, size: tuple[int, int]) -> None:
    """Adds a camera that sees the whole model, for one that has none."""
    width, height = size
    focal = pinhole.focal_from_fov(height, np.radians(model.vis.global_.fovy))
    centre, distance = np.array(model.stat.center), 2.5 * model.stat.extent
    start = se3.look_at(centre + distance * np.array([0.6, -0.7, 0.4]), centre)
    scene.bodies.append(Body("cam0", Prescribed(start)))
    scene.cameras.append(Camera("cam0", width, height, pinhole.intrinsics(width, height, focal)))


def _frame(scene: Scene, model: Any, data: Any, i: int, name: str) -> Body:
    mode, body, target = int(model.cam_mode[i]), int(model.cam_bodyid[i]), int(model.cam_targetbodyid[i])
    if mode == MODE.mjCAMLIGHT_FIXED or (mode in TARGETS and target < 0):
        offset = se3.make_pose(model.cam_pos[i], se3.multiply(se3.from_mujoco(model.cam_quat[i]), FLIP))
        return rigid_frame(scene, name, body - 1, offset)
    if stays(model, mode, body, target):
        turn = se3.multiply(se3.from_matrix(data.cam_xmat[i].reshape(3, 3)), FLIP)
        return Body(name, Prescribed(se3.make_pose(data.cam_xpos[i], turn)))
    return Body(name, None, follows=("camera", i))


def _intrinsics(model: Any, i: int, size: tuple[int, int]) -> np.ndarray:
    width, height = size
    k = pinhole.intrinsics(width, height, pinhole.focal_from_fov(height, np.radians(model.cam_fovy[i])))
    if model.cam_sensorsize[i, 1] > 0:
        k[[0, 1], [0, 1]] = model.cam_intrinsic[i, :2] / model.cam_sensorsize[i] * size
    return k
