"""Reads states of the environments of a model at one time, and between two steps: arrays by name, [E, ...] each.

pose [E, n, 7] and twist [E, n, 6] are of the model's bodies without the world, then of what follows them; qpos [E, nq]
and qvel [E, nv] are the joints'.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from evis.geometry import se3
from nodes.physics.dynamics.followers import Followers

State = dict[str, np.ndarray]


def twist_and_pose(
    model: Any, xpos: np.ndarray, xquat: np.ndarray, cvel: np.ndarray, com: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Computes twists [..., bodies, 6] and poses [..., bodies, 7] of all bodies but the world, in the world.

    xpos, xquat, cvel, com (subtree_com): as MuJoCo has them, of all bodies.
    """
    pose = np.concatenate((xpos[..., 1:, :], se3.from_mujoco(xquat[..., 1:, :])), axis=-1)
    # cvel is (omega, v) of the point of the body that is at the centre of mass of its kinematic tree
    omega, v = cvel[..., 1:, :3], cvel[..., 1:, 3:]
    arm = xpos[..., 1:, :] - com[..., model.body_rootid[1:], :]
    return np.concatenate((v + se3.cross(omega, arm), omega), axis=-1), pose


def snapshot(model: Any, datas: Sequence[Any], followers: Followers) -> State:
    """Reads the state of every environment, after mj_kinematics, mj_comPos and mj_comVel."""
    bodies = model.nbody - 1
    n = bodies + len(followers)
    result = {"pose": np.empty((len(datas), n, 7)), "twist": np.empty((len(datas), n, 6))}
    result["qpos"], result["qvel"] = np.empty((len(datas), model.nq)), np.empty((len(datas), model.nv))
    for k, data in enumerate(datas):
        pose, twist = result["pose"][k], result["twist"][k]
        places = data.xpos, data.xquat, data.cvel, data.subtree_com
        twist[:bodies], pose[:bodies] = twist_and_pose(model, *places)
        if len(followers):
            velocity = np.concatenate((np.zeros((1, 6)), twist[:bodies]))
            pose[bodies:], twist[bodies:] = followers.state(data, velocity)
        result["qpos"][k], result["qvel"][k] = data.qpos, data.qvel
    return result


def joints_between(model: Any, before: State, now: State, u: float) -> State:
    """Computes qpos and qvel at the share u of the time from `before` to `now`."""
    qpos = np.empty_like(now["qpos"])
    for k, (a, b) in enumerate(zip(before["qpos"], now["qpos"])):
        rate = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, rate, 1.0, a, b)
        qpos[k] = a
        mujoco.mj_integratePos(model, qpos[k], rate, u)
    return {"qpos": qpos, "qvel": (1 - u) * before["qvel"] + u * now["qvel"]}
