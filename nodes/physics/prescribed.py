"""Prescribed motion: no integration, so no error at any time. Loads no physics engine."""

from __future__ import annotations

import numpy as np

from evis.scene.model import Scene, Trajectory
from evis.scene.motion import Known, Prescribed
from nodes.physics.interval import Interval, grid_inside


class PrescribedEngine:
    """Closed-form poses on the scene's sub-step grid. All environments are alike: there is nothing random in them."""

    controls = 0

    def __init__(self, scene: Scene, envs: int = 1) -> None:
        self.scene = scene
        self._states = PrescribedStates(scene)
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
        pose, twist = self._states.at(t)
        return Interval(
            t, np.broadcast_to(pose, (self.envs, *pose.shape)), np.broadcast_to(twist, (self.envs, *twist.shape))
        )


class PrescribedStates:
    """Closed-form states of a scene's bodies; those that never move are looked at once."""

    def __init__(self, scene: Scene) -> None:
        self._rest = np.full((len(scene.bodies), 7), np.nan)
        self._still = np.zeros(len(scene.bodies), bool)
        self._moving: list[tuple[int, Trajectory]] = []
        for n, body in enumerate(scene.bodies):
            if body.trajectory is None:
                continue
            self._still[n] = body.trajectory.is_static()
            if self._still[n]:
                self._rest[n] = body.trajectory.pose(np.zeros(1, np.int64))[0]
            else:
                self._moving.append((n, body.trajectory))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses [S, N, 7] and twists [S, N, 6] at times int64 [S] ns; NaN for bodies that the physics engine moves."""
        pose, twist = np.tile(self._rest, (len(t), 1, 1)), np.full((len(t), len(self._rest), 6), np.nan)
        twist[:, self._still] = 0.0
        known: Known = {}
        for n, trajectory in self._moving:
            if isinstance(trajectory, Prescribed):
                pose[:, n], twist[:, n] = trajectory.state(t, known)
            else:
                pose[:, n], twist[:, n] = trajectory.pose(t), trajectory.twist(t)
        return pose, twist


def prescribed_states(scene: Scene, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As PrescribedStates.at, for once."""
    return PrescribedStates(scene).at(t)
