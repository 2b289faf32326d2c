"""Prescribed motion: no integration, so no error at any time. Loads no physics engine."""

from __future__ import annotations

import numpy as np

from evis.scene.model import Scene
from nodes.physics.interval import Interval, grid_inside


class PrescribedEngine:
    """Closed-form poses on the scene's sub-step grid. All environments are alike: there is nothing random in them."""

    controls = 0

    def __init__(self, scene: Scene, envs: int = 1) -> None:
        self.scene = scene
        self.envs = envs
        self._now = 0

    def start(self) -> Interval:
        """The state at stamp 0."""
        return self._at(np.zeros(1, np.int64))

    def advance(self, to_ns: int, controls: np.ndarray | None = None) -> Interval:
        """The states from the previous stamp to `to_ns`; there is nothing to control."""
        t = np.concatenate(([self._now], grid_inside(self._now, to_ns, self.scene.timestep_ns), [to_ns]))
        self._now = to_ns
        return self._at(t)

    def _at(self, t: np.ndarray) -> Interval:
        pose, twist = prescribed_states(self.scene, t)
        return Interval(
            t, np.broadcast_to(pose, (self.envs, *pose.shape)), np.broadcast_to(twist, (self.envs, *twist.shape))
        )


def prescribed_states(scene: Scene, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses [S, N, 7] and twists [S, N, 6] at times int64 [S] ns; NaN for bodies that the physics engine moves."""
    pose, twist = np.full((len(t), len(scene.bodies), 7), np.nan), np.full((len(t), len(scene.bodies), 6), np.nan)
    for n, body in enumerate(scene.bodies):
        if body.trajectory is not None:
            pose[:, n], twist[:, n] = body.trajectory.pose(t), body.trajectory.twist(t)
    return pose, twist
