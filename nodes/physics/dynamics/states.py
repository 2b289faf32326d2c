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
from nodes.physics.dynamics.poses_between import poses_between

State = dict[str, np.ndarray]


def snapshot(model: Any, datas: Sequence[Any], followers: Followers) -> State:
    """Reads the state of every environment, after mj_kinematics, mj_comPos and mj_comVel."""
    bodies = model.nbody - 1
    n = bodies + len(followers)
    result = {"pose": np.empty((len(datas), n, 7)), "twist": np.empty((len(datas), n, 6))}
    result["qpos"], result["qvel"] = np.empty((len(datas), model.nq)), np.empty((len(datas), model.nv))
    for k, data in enumerate(datas):
        pose, twist = result["pose"][k], result["twist"][k]
        pose[:bodies, :3] = data.xpos[1:]
        pose[:bodies, 3:] = se3.from_mujoco(data.xquat[1:])
        # cvel is (omega, v) of the point of the body that is at the centre of mass of its kinematic tree
        omega, v = data.cvel[1:, :3], data.cvel[1:, 3:]
        arm = data.xpos[1:] - data.subtree_com[model.body_rootid[1:]]
        twist[:bodies, :3] = v + se3.cross(omega, arm)
        twist[:bodies, 3:] = omega
        if len(followers):
            velocity = np.concatenate((np.zeros((1, 6)), twist[:bodies]))
            pose[bodies:], twist[bodies:] = followers.state(data, velocity)
        result["qpos"][k], result["qvel"][k] = data.qpos, data.qvel
    return result


def between(model: Any, before: State, now: State, times: np.ndarray, t: int, joints: bool = True) -> State:
    """Computes the state at t [ns] between `before` and `now`, which are at times int64 [2] ns.

    joints: whether with qpos and qvel. Velocities lie on a straight line. The derivative of the poses' cubic would not
    do: most integrators move a body by the velocity after the step, p1 = p0 + h v1, and it overshoots v1 then.
    """
    u = (t - times[0]) / (times[1] - times[0])
    poses, twists = (np.stack((before[n], now[n]), axis=1) for n in ("pose", "twist"))
    state = {"pose": poses_between(t, times, poses, twists), "twist": (1 - u) * before["twist"] + u * now["twist"]}
    if joints:
        qpos = np.empty_like(now["qpos"])
        for k, (a, b) in enumerate(zip(before["qpos"], now["qpos"])):
            rate = np.empty(model.nv)
            mujoco.mj_differentiatePos(model, rate, 1.0, a, b)
            qpos[k] = a
            mujoco.mj_integratePos(model, qpos[k], rate, u)
        state |= {"qpos": qpos, "qvel": (1 - u) * before["qvel"] + u * now["qvel"]}
    return state
