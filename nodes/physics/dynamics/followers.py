"""Computes cameras and lights that MuJoCo moves by a rule of their own: they track a body, or look at one.

Poses are MuJoCo's (`mj_camlight`), velocities the time derivatives of the same rules in closed form: a frame that
tracks has the velocity of its body's origin, or of its subtree's centre of mass, and does not turn; one that targets
has the velocity of a point of its body and turns with the line of sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from evis.geometry import se3
from evis.scene.mjcf.cameras import FLIP
from evis.scene.mjcf.frames import MODE, TRACKS

_UP = np.array([0.0, 0.0, 1.0])


class Followers:
    """Computes the frames of one model. follows: (`camera` or `light`, its number in the model) of each."""

    def __init__(self, model: Any, follows: Sequence[tuple[str, int]]) -> None:
        self.model = model
        self._follows = list(follows)

    def __len__(self) -> int:
        return len(self._follows)

    def state(self, data: Any, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes poses float64 [F, 7] and twists [F, 6] (v, omega; world frame), in the order given.

        data: after mj_kinematics, mj_comPos and mj_comVel. velocity: float64 [nbody, 6], twists of the model's body
        frames, the world's among them. A camera's pose has z forward, a light's turns its direction at rest into the
        present one.
        """
        pose, twist = np.empty((len(self), 7)), np.zeros((len(self), 6))
        mujoco.mj_camlight(self.model, data)
        mujoco.mj_subtreeVel(self.model, data)
        for row, (kind, i) in enumerate(self._follows):
            if kind == "camera":
                pose[row], twist[row] = self._camera(data, velocity, i)
            else:
                pose[row], twist[row] = self._light(data, velocity, i)
        return pose, twist

    def _camera(self, data: Any, velocity: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        model = self.model
        mode, place, axes = int(model.cam_mode[i]), data.cam_xpos[i], data.cam_xmat[i].reshape(3, 3)
        pose = se3.make_pose(place, se3.multiply(se3.from_matrix(axes), FLIP))
        if mode in TRACKS:
            return pose, _tracking(data, velocity, mode, model.cam_bodyid[i])
        sight, drift, v = _targeting(data, velocity, mode, model.cam_bodyid[i], model.cam_targetbodyid[i], place)
        return pose, np.concatenate((v, _look_rate(axes, -sight, -drift)))

    def _light(self, data: Any, velocity: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        model = self.model
        mode, place = int(model.light_mode[i]), data.light_xpos[i]
        if mode in TRACKS:
            return se3.make_pose(place, se3.IDENTITY[3:]), _tracking(data, velocity, mode, model.light_bodyid[i])
        sight, drift, v = _targeting(data, velocity, mode, model.light_bodyid[i], model.light_targetbodyid[i], place)
        turn, rate = _swing(model.light_dir0[i], data.light_xdir[i], _unit_rate(sight, drift))
        return se3.make_pose(place, turn), np.concatenate((v, rate))


def _tracking(data: Any, velocity: np.ndarray, mode: int, body: int) -> np.ndarray:
    v = data.subtree_linvel[body] if mode == MODE.mjCAMLIGHT_TRACKCOM else velocity[body, :3]
    return np.concatenate((v, np.zeros(3)))


def _targeting(
    data: Any, velocity: np.ndarray, mode: int, body: int, target: int, place: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Computes the way from a frame at `place` on `body` to its target [m], the derivative of that, and the frame's
    velocity [m/s]."""
    v = velocity[body, :3] + np.cross(velocity[body, 3:], place - data.xpos[body])
    if mode == MODE.mjCAMLIGHT_TARGETBODYCOM:
        return data.subtree_com[target] - place, data.subtree_linvel[target] - v, v
    return data.xpos[target] - place, velocity[target, :3] - v, v


def _unit_rate(vector: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Computes the derivative of vector / |vector|; 0 for none."""
    square = vector @ vector
    if square < 1e-24:
        return np.zeros(3)
    return (rate - vector * (vector @ rate / square)) / np.sqrt(square)


def _look_rate(axes: np.ndarray, back: np.ndarray, back_rate: np.ndarray) -> np.ndarray:
    """Computes the angular velocity of the frame with columns z = back / |back|, x = up x z / |up x z| and y = z x x.

    Straight up or down x is undefined, and MuJoCo takes the world's; there only z counts.
    """
    x, y, z = axes.T
    dz = _unit_rate(back, back_rate)
    dx = _unit_rate(np.cross(_UP, z), np.cross(_UP, dz))
    dy = np.cross(dz, x) + np.cross(z, dx)
    return 0.5 * (np.cross(x, dx) + np.cross(y, dy) + np.cross(z, dz))


def _swing(start: np.ndarray, now: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes the shortest turn from one unit vector to another, x y z w, and its angular velocity where `now` has
    `rate`."""
    q = np.append(np.cross(start, now), 1.0 + start @ now)
    length = np.linalg.norm(q)
    if length < 1e-6:  # opposite: half a turn about any axis across
        axis = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
        return np.append(axis / np.linalg.norm(axis), 0.0), np.cross(now, rate)
    q /= length
    # Where q grows or shrinks, that is no turn: it ends up in the fourth component.
    change = np.append(np.cross(start, rate), start @ rate) / length
    return q, 2.0 * se3.multiply(change, se3.conjugate(q))[:3]
