"""Makes frames of a MuJoCo model's cameras and lights: rigid on a body, or moved by a rule of their own (their
`mode`)."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.geometry import se3
from evis.scene.model import WORLD, Body, Scene
from evis.scene.motion import Prescribed

MODE = mujoco.mjtCamLight
TRACKS = (MODE.mjCAMLIGHT_TRACK, MODE.mjCAMLIGHT_TRACKCOM)
"""Keeps its direction in the world, and its place beside its body or the centre of mass of the body's subtree."""
TARGETS = (MODE.mjCAMLIGHT_TARGETBODY, MODE.mjCAMLIGHT_TARGETBODYCOM)
"""Rigid on its body, but looks at another body, or at the centre of mass of that one's subtree."""


def name_of(model: Any, kind: Any, i: int, default: str) -> str:
    """Returns the name of a model's element, or `default` with its number, and a _ where another is called that."""
    name = mujoco.mj_id2name(model, kind, i)
    if not name:
        name = f"{default}{i}"
        while mujoco.mj_name2id(model, kind, name) >= 0:
            name += "_"
    return str(name)


def free_name(scene: Scene, name: str, ending: str) -> str:
    """Returns `name`, with `ending` as often as it takes for no body of the scene to have it."""
    taken = {body.name for body in scene.bodies}
    while name in taken:
        name = f"{name}_{ending}"
    return name


def rigid_frame(scene: Scene, name: str, body: int, offset: np.ndarray) -> Body:
    """Makes a frame at a pose, float64 [7], in that of body number `body` of the scene."""
    outer = scene.bodies[body].trajectory if body != WORLD else None
    if body == WORLD or outer is not None:
        assert outer is None or isinstance(outer, Prescribed)
        return Body(name, Prescribed(offset, parent=outer))
    return Body(name, None, mount=(body, offset))


def stays(model: Any, mode: int, body: int, target: int) -> bool:
    """Tells whether a frame of this mode never moves. body, target: the model's numbers of its own and its target
    body.
    """
    if model.body_weldid[body] != 0 or mode == MODE.mjCAMLIGHT_TRACKCOM:
        return False
    return mode not in TARGETS or (mode == MODE.mjCAMLIGHT_TARGETBODY and model.body_weldid[target] == 0)


def rest_poses(model: Any) -> np.ndarray:
    """Computes the poses float64 [nbody - 1, 7] of a model's bodies, without the world, in its reference pose."""
    data = at_rest(model)
    return (
        np.stack([se3.make_pose(data.xpos[i], se3.from_mujoco(data.xquat[i])) for i in range(1, model.nbody)])
        if model.nbody > 1
        else np.empty((0, 7))
    )


def at_rest(model: Any) -> Any:
    """Makes MjData in the model's reference pose, with the places of bodies, cameras and lights."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    return data
