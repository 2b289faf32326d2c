"""Adds the cameras of a MuJoCo model."""

from __future__ import annotations

import re
from typing import Any

import mujoco
import numpy as np

from evis.geometry import pinhole, se3
from evis.scene.errors import SceneError
from evis.scene.mjcf.frames import MODE, TARGETS, free_name, name_of, rigid_frame, stays
from evis.scene.model import Body, Camera, Scene
from evis.scene.motion import Prescribed

FLIP = np.array([1.0, 0.0, 0.0, 0.0])
"""MuJoCo's cameras look along -z with y up: half a turn about x."""


def add_cameras(scene: Scene, model: Any, data: Any, size: tuple[int, int]) -> None:
    """Adds all cameras that can be simulated, each with a body, and a note of each of the others. size: width and
    height [px].

    Raises SceneError for a field of view or a focal length that no camera has.
    """
    for i in range(model.ncam):
        name = name_of(model, mujoco.mjtObj.mjOBJ_CAMERA, i, "camera")
        if model.cam_projection[i] != mujoco.mjtProjection.mjPROJ_PERSPECTIVE:
            told = 'it is orthographic; with projection="perspective" and a fovy in degrees it is taken'
            scene.notes.append(f"camera '{name}' is left out: {told}")
            continue
        k = _intrinsics(scene, model, i, size, name)
        # It is part of the names of topics; MuJoCo's own tools put a / into those of attached models.
        name = free_name(scene, re.sub(r"[^\w.-]", "_", name), "camera")
        scene.bodies.append(_frame(scene, model, data, i, name))
        scene.cameras.append(Camera(name, *size, k))


def add_default(scene: Scene, model: Any, size: tuple[int, int]) -> None:
    """Adds a camera that sees the whole model, for one that has none. Raises SceneError as `add_cameras`."""
    width, height = size
    focal = _focal(scene, height, float(model.vis.global_.fovy), "<visual><global>")
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


def _intrinsics(scene: Scene, model: Any, i: int, size: tuple[int, int], name: str) -> np.ndarray:
    width, height = size
    if model.cam_sensorsize[i, 1] <= 0:
        return pinhole.intrinsics(width, height, _focal(scene, height, float(model.cam_fovy[i]), f"camera '{name}'"))
    # What MuJoCo calls principal is where the middle of the sensor lies from the optical axis, to the right and up.
    focal, middle = model.cam_intrinsic[i].astype(np.float64).reshape(2, 2) / model.cam_sensorsize[i] * size
    if not (np.isfinite([focal, middle]).all() and (focal > 0).all()):
        raise SceneError(
            f"{_file(scene)}: camera '{name}' has focal lengths {focal[0]:.6g} and {focal[1]:.6g} px and its "
            f"principal point {middle[0]:.6g} and {middle[1]:.6g} px off; give it a focal above 0, a finite principal"
        )
    k = pinhole.intrinsics(width, height, 1.0)
    k[[0, 1], [0, 1]] = focal
    k[:2, 2] -= middle
    return k


def _focal(scene: Scene, height: int, fovy: float, what: str) -> float:
    """The focal length [px] of a field of view [degrees] that `what` has in the model."""
    if not 0 < fovy < 180:
        raise SceneError(f"{_file(scene)}: {what} has fovy {fovy:g}; it must be above 0 and below 180 degrees")
    return pinhole.focal_from_fov(height, np.radians(fovy))


def _file(scene: Scene) -> str:
    assert scene.mjcf is not None
    return scene.mjcf.name
