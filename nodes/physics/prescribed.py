"""Prescribed motion: no integration, so no error at any time. Loads no physics engine."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from evis.scene.model import Scene, Trajectory
from evis.scene.motion import Known, Prescribed
from nodes.physics.accelerations import prescribed_accelerations
from nodes.physics.from_outside import Actuators
from nodes.physics.interval import Interval, grid_inside


class PrescribedEngine:
    """Gives closed-form poses on the scene's sub-step grid. All environments are alike: nothing in them is random."""

    controls = 0
    actuators = Actuators()

    def __init__(self, scene: Scene, envs: int = 1, accelerations: bool = False) -> None:
        """accelerations: whether intervals have them."""
        self.scene = scene
        self._accelerations = accelerations
        self._states = PrescribedStates(scene)
        self.envs = envs
        self._now = 0

    def start(self) -> Interval:
        """Gives the state at stamp 0."""
        return self._at(np.zeros(1, np.int64))

    def rewind(self, seed: int) -> None:
        """Goes back to stamp 0."""
        self._now = 0

    def advance(self, to_ns: int, controls: np.ndarray | None = None) -> Interval:
        """Gives the states from the previous stamp to `to_ns` [ns]; there is nothing to control."""
        # Where nothing moves nothing happens at sub-steps.
        inner = grid_inside(self._now, to_ns, self.scene.timestep_ns) if len(self._states.moving) else ()
        t = np.array([self._now, *inner, to_ns], np.int64)
        self._now = to_ns
        return self._at(t)

    def leave(self, env: int) -> None:
        """Does nothing: one environment more costs nothing."""

    def missed(self) -> int:
        """Counts none: nothing is integrated."""
        return 0

    def anew(self, envs: Sequence[int], seeds: Sequence[int | None], numbers: Sequence[int]) -> PrescribedEngine:
        """Makes an engine of as many environments, at stamp 0; nothing depends on seeds and numbers."""
        engine = copy.copy(self)
        engine.envs, engine._now = len(envs), 0
        return engine

    def _at(self, t: np.ndarray) -> Interval:
        states = self._states
        pose, twist = states.of_moving(t)
        end = states.rest.copy()
        end[states.moving] = pose[-1]
        ends, poses, twists = (np.broadcast_to(a, (self.envs, *a.shape)) for a in (end, pose, twist))
        interval = Interval(t, ends, states.moving, poses, twists)
        if self._accelerations:
            interval.acceleration = np.tile(prescribed_accelerations(self.scene, int(t[-1])), (self.envs, 1, 1))
        return interval


class PrescribedStates:
    """Computes closed-form states of a scene's bodies; those that never move are looked at once.

    moving: int32 [B], bodies on a path along which they move. rest: float64 [N, 7], poses of those that never do, NaN
    for the others.
    """

    def __init__(self, scene: Scene) -> None:
        self.rest = np.full((len(scene.bodies), 7), np.nan)
        self._still = np.zeros(len(scene.bodies), bool)
        paths: list[tuple[int, Trajectory]] = []
        for n, body in enumerate(scene.bodies):
            if body.trajectory is None:
                continue
            self._still[n] = body.trajectory.is_static()
            if self._still[n]:
                self.rest[n] = body.trajectory.pose(np.zeros(1, np.int64))[0]
            else:
                paths.append((n, body.trajectory))
        self.moving = np.array([n for n, _ in paths], np.int32)
        self._paths = [path for _, path in paths]

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes poses [S, N, 7] and twists [S, N, 6] at times int64 [S] ns; NaN for bodies that a physics engine
        moves."""
        pose, twist = np.tile(self.rest, (len(t), 1, 1)), np.full((len(t), len(self.rest), 6), np.nan)
        twist[:, self._still] = 0.0
        pose[:, self.moving], twist[:, self.moving] = self.of_moving(t)
        return pose, twist

    def of_moving(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes poses [S, B, 7] and twists [S, B, 6] of the bodies of `moving` alone."""
        pose, twist = np.empty((len(t), len(self.moving), 7)), np.empty((len(t), len(self.moving), 6))
        known: Known = {}
        for n, path in enumerate(self._paths):
            if isinstance(path, Prescribed):
                pose[:, n], twist[:, n] = path.state(t, known)
            else:
                pose[:, n], twist[:, n] = path.pose(t), path.twist(t)
        return pose, twist


def prescribed_states(scene: Scene, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes what PrescribedStates.at gives, for who asks once."""
    return PrescribedStates(scene).at(t)
