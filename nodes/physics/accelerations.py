"""Computes accelerations of bodies at one instant: in closed form, or those of a MuJoCo state's forces."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.geometry import se3
from evis.scene.model import Scene
from evis.scene.motion import Prescribed


def prescribed_accelerations(scene: Scene, t_ns: int) -> np.ndarray:
    """Computes the accelerations float64 [N, 6] (a, alpha; world) of a scene's bodies at one time, in closed form.

    NaN for bodies that an engine moves.
    """
    result = np.full((len(scene.bodies), 6), np.nan)
    for n, body in enumerate(scene.bodies):
        if isinstance(body.trajectory, Prescribed):
            result[n] = body.trajectory.acceleration(np.array([t_ns], np.int64))[0]
    return result


def mujoco_accelerations(model: Any, data: Any, scratch: Any, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Computes the accelerations float64 [nbody - 1, 6] (a, alpha; world) of a model's bodies at their origins.

    They are those of mj_forward (qacc, brought to the bodies as cacc) for positions qpos and velocities qvel under the
    controls of `data`: of a state's forces, not of a step. Worked out on `scratch`, another MjData of the model, so
    that the simulation takes its course.
    """
    import mujoco

    from nodes.physics.dynamics.sleep import wake

    mujoco.mj_copyData(scratch, model, data)
    wake(model, scratch)
    scratch.qpos[:], scratch.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, scratch)
    mujoco.mj_rnePostConstraint(model, scratch)
    result, one = np.empty((model.nbody - 1, 6)), np.empty(6)
    for n in range(model.nbody - 1):
        mujoco.mj_objectAcceleration(model, scratch, mujoco.mjtObj.mjOBJ_XBODY, n + 1, one, 0)
        result[n, :3], result[n, 3:] = one[3:], one[:3]
    # cacc is what an accelerometer feels: a body at rest has -g.
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        result[:, :3] += model.opt.gravity
    return result


def mounted_acceleration(
    pose: np.ndarray, twist: np.ndarray, acceleration: np.ndarray, offset: np.ndarray
) -> np.ndarray:
    """Computes the acceleration [E, 6] of a frame that is fixed on a body at `offset` float64 [7].

    pose [E, 7], twist [E, 6], acceleration [E, 6]: of the body.
    """
    none = np.zeros(6)
    return se3.compose_acceleration(pose, twist, acceleration, offset, none, none)
