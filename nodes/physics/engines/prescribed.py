"""Computes prescribed motion: no integration, so no error at any time. Loads no physics engine."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numpy as np

from evis.scene.model import Scene, Trajectory
from evis.scene.motion import Prescribed
from evis.scene.prescribed_batch import PrescribedBatch
from nodes.physics.accelerations import prescribed_accelerations
from nodes.physics.actuators import Actuators
from nodes.physics.closed_form.ahead import BLOCK, StatesAhead
from nodes.physics.interval import Interval


class PrescribedEngine:
    """Gives closed-form poses on the scene's sub-step grid. All environments are alike: nothing in them is random."""

    actuators = Actuators()
    step_ns = 0

    def __init__(
        self,
        scene: Scene,
        envs: int = 1,
        accelerations: bool = False,
        keyframe_rate: float | None = None,
        beside: int = 1,
        inside: Callable[[], bool] = lambda: True,
    ) -> None:
        """Makes the engine of a scene. accelerations: whether intervals have them. keyframe_rate: of the stamps that
        will be asked for [Hz], so that many are computed at once; None = any. beside: environments of all engines that
        share the memory for that. inside: tells whether anybody looks at the sub-steps between two stamps now."""
        self.scene = scene
        self._accelerations = accelerations
        self._states = PrescribedStates(scene)
        self._keyframe_rate, self._inside = keyframe_rate, inside
        self.envs, self._beside = envs, max(beside, envs)
        self._begin()

    def _begin(self) -> None:
        """Stands at stamp 0."""
        states, block = self._states, BLOCK * self.envs // self._beside
        self._now = 0
        self._ahead = StatesAhead(
            states.of_moving, len(states.moving), self.scene.timestep_ns, self._keyframe_rate, block
        )

    def start(self) -> Interval:
        """Gives the state at stamp 0."""
        t = np.zeros(1, np.int64)
        return self._interval(t, *self._states.of_moving(t))

    def rewind(self, seed: int) -> None:
        """Goes back to stamp 0."""
        self._begin()

    def advance(self, to_ns: int, controls: np.ndarray | None = None) -> Interval:
        """Gives the states from the previous stamp to `to_ns` [ns]; there is nothing to control."""
        start, self._now = self._now, to_ns
        return self._interval(*self._ahead.between(start, to_ns, self._inside()))

    def leave(self, env: int) -> None:
        """Does nothing: one environment more costs nothing."""

    def missed(self) -> int:
        """Counts none: nothing is integrated."""
        return 0

    def anew(self, envs: Sequence[int], seeds: Sequence[int | None], numbers: Sequence[int]) -> PrescribedEngine:
        """Makes an engine of as many environments, at stamp 0; nothing depends on seeds and numbers."""
        return self.part(envs)

    def part(self, envs: Sequence[int]) -> PrescribedEngine:
        """Makes an engine of as many environments, at stamp 0."""
        engine = copy.copy(self)
        engine.envs = len(envs)
        engine._begin()
        return engine

    def state(self) -> int:
        """Gives the stamp [ns] that it is at."""
        return self._now

    def restore(self, state: int) -> None:
        """Goes on from a stamp [ns]."""
        self._begin()
        self._now = state

    def _interval(self, t: np.ndarray, pose: np.ndarray, twist: np.ndarray) -> Interval:
        states = self._states
        end = states.rest.copy()
        end[states.moving] = pose[-1]
        ends, poses, twists = (self._of_all(values) for values in (end, pose, twist))
        interval = Interval(t, ends, states.moving, poses, twists, lasting=True)
        if self._accelerations:
            interval.acceleration = np.tile(prescribed_accelerations(self.scene, int(t[-1])), (self.envs, 1, 1))
        return interval

    def _of_all(self, values: np.ndarray) -> np.ndarray:
        """Repeats values that all environments have in common for each of them, in the same memory."""
        if self.envs == 1:  # by far the usual case, and a tenth of the time
            return values[None]
        return np.broadcast_to(values, (self.envs, *values.shape))


class PrescribedStates:
    """Computes closed-form states of a scene's bodies; those of bodies that never move only once.

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
        # With their rows among the moving bodies.
        self._alone = [(m, path) for m, (_, path) in enumerate(paths) if not isinstance(path, Prescribed)]
        known = [(m, path) for m, (_, path) in enumerate(paths) if isinstance(path, Prescribed)]
        self._known = np.array([m for m, _ in known], np.int64)
        self._batch = PrescribedBatch([path for _, path in known])

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes poses [S, N, 7] and twists [S, N, 6] at times int64 [S] ns; NaN for bodies that a physics engine
        moves."""
        pose, twist = np.tile(self.rest, (len(t), 1, 1)), np.full((len(t), len(self.rest), 6), np.nan)
        twist[:, self._still] = 0.0
        pose[:, self.moving], twist[:, self.moving] = self.of_moving(t)
        return pose, twist

    def of_moving(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes poses [S, B, 7] and twists [S, B, 6] of the bodies of `moving` alone."""
        if not self._alone:
            return self._batch.at(t)
        pose, twist = np.empty((len(t), len(self.moving), 7)), np.empty((len(t), len(self.moving), 6))
        pose[:, self._known], twist[:, self._known] = self._batch.at(t)
        for m, path in self._alone:
            pose[:, m], twist[:, m] = path.pose(t), path.twist(t)
        return pose, twist


def prescribed_states(scene: Scene, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes poses and twists as PrescribedStates.at does, for a single call."""
    return PrescribedStates(scene).at(t)
