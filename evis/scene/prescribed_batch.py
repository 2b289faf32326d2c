"""Computes prescribed motion of many bodies at once: one pass over all with the same kinds of motion.

Physics takes their states from it, the interpolator their poses alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.geometry import se3
from evis.scene.motion import (
    NS,
    Prescribed,
    Rotation,
    Shift,
    carried,
    kind,
    local_pose,
    local_state,
    stacked,
    with_parents,
)


@dataclass(frozen=True)
class SameMotion:
    """Holds B bodies whose translations and rotations are of the same kinds.

    rows, parents: int64 [B], numbers of the bodies and of those that carry them; no parents = the world. start:
    float64 [B, 7], poses at time 0. shifts, turns: translations and rotations, each with the parameters of all bodies.
    """

    rows: np.ndarray
    parents: np.ndarray
    start: np.ndarray
    shifts: list[Shift]
    turns: list[Rotation]


class PrescribedBatch:
    """Computes `Prescribed.state` and `Prescribed.pose` of several bodies at once, to the bit: a pose does not hang on
    how many times and bodies are asked for with it."""

    def __init__(self, paths: Sequence[Prescribed]) -> None:
        nodes = with_parents(paths)
        row = {id(path): n for n, path in enumerate(nodes)}
        self._rows = np.array([row[id(path)] for path in paths], np.int64)
        still = [n for n, path in enumerate(nodes) if path.is_static()]
        self._still = np.array(still, np.int64)
        self._rest = np.array([nodes[n].pose(np.zeros(1, np.int64)) for n in still]).reshape(-1, 1, 7)
        self._count = len(nodes)
        kinds: dict[Any, list[int]] = {}
        for n, path in enumerate(nodes):
            if not path.is_static():
                how = tuple(map(kind, path.shifts)), tuple(map(kind, path.turns))
                kinds.setdefault((path.depth, how), []).append(n)
        self._groups: list[SameMotion] = []
        for (depth, _), rows in sorted(kinds.items(), key=lambda item: item[0][0]):
            members = [nodes[n] for n in rows]
            parents = [row[id(path.parent)] for path in members if depth]
            start = np.array([path.start for path in members])
            shifts, turns = ([stacked(same) for same in zip(*each)] for each in _motions(members))
            self._groups.append(SameMotion(np.array(rows), np.array(parents, np.int64), start, shifts, turns))

    def at(self, t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes poses float64 [S, B, 7] and twists [S, B, 6] in the world at times int64 [S] ns, in the order of the
        paths."""
        t = np.asarray(t_ns, np.int64) * NS
        pose, twist = np.empty((self._count, len(t), 7)), np.empty((self._count, len(t), 6))
        pose[self._still], twist[self._still] = self._rest, 0.0
        for group in self._groups:
            state = local_state(group.start, group.shifts, group.turns, t)
            if len(group.parents):
                state = carried((pose[group.parents], twist[group.parents]), state)
            pose[group.rows], twist[group.rows] = state
        return _by_time(pose[self._rows]), _by_time(twist[self._rows])

    def poses_at(self, t_ns: np.ndarray) -> np.ndarray:
        """Computes the poses of `at` alone."""
        t = np.asarray(t_ns, np.int64) * NS
        pose = np.empty((self._count, len(t), 7))
        pose[self._still] = self._rest
        for group in self._groups:
            local = local_pose(group.start, group.shifts, group.turns, t)
            pose[group.rows] = se3.compose(pose[group.parents], local) if len(group.parents) else local
        return _by_time(pose[self._rows])


def _motions(paths: Sequence[Prescribed]) -> tuple[list[list[Shift]], list[list[Rotation]]]:
    """Lists the translations and rotations of each path."""
    return [path.shifts for path in paths], [path.turns for path in paths]


def _by_time(values: np.ndarray) -> np.ndarray:
    """Swaps bodies and times."""
    return np.ascontiguousarray(np.swapaxes(values, 0, 1))
