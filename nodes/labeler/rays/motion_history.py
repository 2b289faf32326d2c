"""Keeps the last states of the bodies, and gives their motion over all of the time that these states cover."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import interpolate
from msgs.own_time import ORIGIN
from msgs.world import WorldState
from nodes.labeler.rays.motion_kernels import Motion

KEPT = 3
"""States that are kept: events may be those of the interval before, and their sub-frames begin before it."""


class MotionHistory:
    """Keeps the last states of E environments, and gives the motion over all of their time."""

    def __init__(self) -> None:
        self._states: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self._motion: Motion | None = None
        self._device: Any = None

    def __getstate__(self) -> dict[str, Any]:
        """Gives what a copy is made of: the states, without what was made of them on a device."""
        return {**self.__dict__, "_motion": None, "_device": None}

    def add(self, state: WorldState) -> None:
        """Takes the next state; one that is not later than those before begins anew."""
        if self._states and state.t[-1] <= self._states[-1][0][-1]:
            self._states = []
        moving = np.array(state.moving, np.int64)
        row = (np.array(state.t), moving, np.array(state.moving_pose), np.array(state.moving_twist))
        self._states = [*self._states, row][-KEPT:]
        self._end = np.array(state.end_pose)
        self._motion = None

    @property
    def known(self) -> bool:
        """Tells whether any state is known."""
        return bool(self._states)

    @property
    def span(self) -> tuple[int, int]:
        """Gives the first and the last time that is known [ns]."""
        return int(self._states[0][0][0]), int(self._states[-1][0][-1])

    def motion(self, device: Any) -> Motion:
        """Gives the motion on a device; where there is only one instant, nothing moves."""
        if self._motion is None or self._device != device:
            self._motion, self._device = self._made(device), device
        return self._motion

    def _made(self, device: Any) -> Motion:
        parts = [part for part in self._states if len(part[0]) > 1]
        if not parts:
            t, moving, pose, twist = self._states[-1]
            none = np.zeros(0, np.int64)
            parts = [(np.append(t, t + 1), none, pose[:, [0, 0]][:, :, none], twist[:, [0, 0]][:, :, none])]
        envs, bodies = self._end.shape[:2]
        columns = np.unique(np.concatenate([part[1] for part in parts]))
        starts, poses, cubics = [], [], []
        for k, (t, moving, pose, twist) in enumerate(parts):
            # What does not move in this interval is where it is in the next state's start, or at the end.
            later = [p for p in parts[k + 1 :]]
            whole = np.empty((envs, len(t), len(columns), 7))
            spin = np.zeros((envs, len(t), len(columns), 6))
            whole[:] = self._rest_after(later, columns)[:, None]
            at = np.searchsorted(columns, moving)
            whole[:, :, at], spin[:, :, at] = pose, twist
            starts.append(t[:-1])
            poses.append(whole[:, :-1])
            cubics.append(interpolate.gaps(t, whole, spin))
        place = np.full(bodies, -1, np.int32)
        place[columns] = np.arange(len(columns))
        motion = Motion()
        motion.start = wp.array(np.append(np.concatenate(starts), parts[-1][0][-1]), dtype=wp.int64, device=device)
        motion.place = wp.array(place, dtype=wp.int32, device=device)
        motion.rest = wp.array(np.ascontiguousarray(self._end), dtype=wp.transformd, device=device)
        motion.pose = wp.array(np.concatenate(poses, 1), dtype=wp.transformd, device=device)
        curves = np.concatenate(cubics, 1)
        motion.cubics = wp.array(curves.reshape(*curves.shape[:3], 6, 3), dtype=wp.vec3d, device=device)
        return motion

    def _rest_after(
        self, later: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]], columns: np.ndarray
    ) -> np.ndarray:
        """Gives poses [E, C, 7] of bodies that rest in an interval: where the next one in which they move begins."""
        rest = self._end[:, columns].copy()
        for _, moving, pose, _ in reversed(later):
            rest[:, np.searchsorted(columns, moving)] = pose[:, 0]
        return rest


class MotionHistories:
    """Keeps the last states in each time that environments have of their own, by its origin [ns] on the stamps."""

    def __init__(self) -> None:
        self._of: dict[int, MotionHistory] = {}
        self._origin = np.zeros(0, np.int64)
        self._episodes = np.zeros(0, np.int32)

    def add(self, state: WorldState) -> None:
        """Takes the next state. One of the last one's stamp is of those alone that begin an episode there."""
        envs = len(state.end_pose)
        origin = np.zeros(envs, np.int64) if state.own is None else np.array(state.own[:, ORIGIN])
        known, self._of = self._of, {}
        for start in np.unique(origin).tolist():
            mine = np.flatnonzero(origin == start)
            history = self._of[start] = known.get(start) or MotionHistory()
            t = np.asarray(state.t if state.own_t is None else state.own_t[mine[0]])
            old = len(self._episodes) == envs and bool((self._origin[mine] == start).all())
            if old and history.known and t[-1] == history.span[1] and self._same(state, mine):
                continue
            steps = np.append(np.diff(t) > 0, True)
            pose, twist = (np.asarray(a)[:, steps] for a in (state.moving_pose, state.moving_twist))
            history.add(replace(state, t=t[steps], moving_pose=pose, moving_twist=twist))
        self._origin, self._episodes = origin, np.array(state.episodes)

    def _same(self, state: WorldState, envs: np.ndarray) -> bool:
        return np.array_equal(np.asarray(state.episodes)[envs], self._episodes[envs])

    def __iter__(self) -> Iterator[tuple[int, np.ndarray, MotionHistory]]:
        """Gives origins, the environments int64 [n] that have it, and the states in that time."""
        for start, history in self._of.items():
            yield start, np.flatnonzero(self._origin == start), history
