"""Gives the poses of all bodies at any instant within the states that have come since the last computation."""

from __future__ import annotations

import numpy as np

from evis.scene.model import Scene
from msgs.world import WorldState
from nodes.interpolator.keyframe import States
from nodes.interpolator.rigid.placement import Placement


class Motion:
    """Keeps states of some environments until `clear`, and gives the poses within them, as `rigid` does."""

    def __init__(self, scene: Scene, envs: np.ndarray) -> None:
        """envs: int64 [A], those whose poses are asked for."""
        self._placement, self._envs = Placement(scene), envs
        self._driven = any(body.trajectory is None for body in scene.bodies)
        self._t: list[np.ndarray] = []
        self._pose: list[np.ndarray] = []
        self._twist: list[np.ndarray] = []

    def add(self, state: WorldState) -> None:
        """Takes the next state; of bodies in closed form only the last one is kept."""
        if self._driven:
            pose, twist = state.rows(envs=self._envs)
        else:
            self.clear()
            pose = np.array(state.end_pose[self._envs])[:, None]
            twist = np.zeros((*pose.shape[:3], 6))
        after = slice(1 if self._t and state.t[0] == self._t[-1][-1] else 0, None)
        self._t.append(np.array(state.t[after] if self._driven else state.t[-1:]))
        self._pose.append(pose[:, after])
        self._twist.append(twist[:, after])

    def clear(self) -> None:
        """Forgets all states."""
        self._t, self._pose, self._twist = [], [], []

    def forget(self) -> None:
        """Forgets all but the end of the last state, where the next one begins."""
        self._t, self._pose, self._twist = self._t[-1:], self._pose[-1:], self._twist[-1:]
        if self._t:
            self._t[0], self._pose[0], self._twist[0] = self._t[0][-1:], self._pose[0][:, -1:], self._twist[0][:, -1:]

    @property
    def movers(self) -> np.ndarray:
        """Gives the bodies that may move, int64 [M]."""
        return self._placement.movers

    def rest(self) -> np.ndarray:
        """Gives poses float64 [N, 7] of all bodies at the end of the last state, in the first environment."""
        return np.array(self._pose[-1][0, -1])

    def moved(self, t: np.ndarray, env: np.ndarray) -> np.ndarray:
        """Gives poses float64 [T, M, 7] of the movers at times int64 [T] ns in environments int64 [T] among `envs`.

        Of bodies that physics moves, a time beyond the states counts as the nearest one within.
        """
        states = States(np.concatenate(self._t), np.concatenate(self._pose, 1), np.concatenate(self._twist, 1))
        if not len(self.movers):
            return np.zeros((len(t), 0, 7))
        times, which = np.unique(t, return_inverse=True)
        inside = np.clip(times, states.t[0], states.t[-1]) if self._driven else times
        moved = self._placement.moved(np.append(inside, states.t[-1]), states)
        return moved[which, env]
