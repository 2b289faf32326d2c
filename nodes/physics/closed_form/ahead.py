"""Computes closed-form states of many keyframes ahead: they depend on time alone, so many cost little more."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from evis.runtime.clock import NS, keyframe_stamp
from nodes.physics.interval import grid_inside
from nodes.physics.room import ROW, check_room

BLOCK = 1 << 20
"""Most bytes of states that are computed at once, unless one interval has more: what a core's cache holds."""

States = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Of an interval: sub-step times int64 [S] ns, poses float64 [S, B, 7] and twists [S, B, 6]; not to be written to."""


class StatesAhead:
    """Gives the states of one interval after another, computed in blocks of 1, 2, 4, ... intervals.

    The first block is one interval, so that its states are there as soon as without blocks.
    """

    def __init__(
        self,
        states: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
        bodies: int,
        timestep_ns: int,
        keyframe_rate: float | None,
        block: int = BLOCK,
    ) -> None:
        """Takes a function of closed-form states, and the grid of its times.

        states: computes poses [S, B, 7] and twists [S, B, 6] of `bodies` B at times int64 [S] ns. timestep_ns:
        sub-step. keyframe_rate: rate [Hz] of the stamps at which intervals begin and end, None = unknown: a block is
        then one interval. block: most bytes of states in a block, unless one interval has more.
        """
        self._states, self._bodies, self._timestep, self._rate = states, bodies, timestep_ns, keyframe_rate
        self._fits = block // (ROW * max(bodies, 1))
        self._stamps: list[int] = []
        self._block: list[States] = []
        self._next = 0
        self._inside = True

    def between(self, start_ns: int, end_ns: int, inside: bool = True) -> States:
        """Gives the states from one stamp to the next: at both, and at the sub-steps inside, where these are wanted."""
        # Without bodies there are no states at sub-steps.
        inside = inside and self._bodies > 0
        if self._stamps[self._next : self._next + 2] != [start_ns, end_ns] or inside != self._inside:
            goes_on = self._stamps[-1:] == [start_ns]
            self._inside = inside
            self._compute(start_ns, end_ns, 2 * len(self._block) if goes_on else 1)
        self._next += 1
        return self._block[self._next - 1]

    def _compute(self, start_ns: int, end_ns: int, count: int) -> None:
        """Computes a block of up to `count` intervals. Raises ValueError where the first alone is too large."""
        if self._inside:
            check_room(end_ns - start_ns, 1 + (end_ns - start_ns) // self._timestep, self._bodies)
        stamps = self._foreseen(start_ns, end_ns, count)
        grids = [np.array([start_ns], np.int64)]
        for a, b in pairwise(stamps):
            grids.append(np.append(grid_inside(a, b, self._timestep) if self._inside else [], b).astype(np.int64))
        ends = np.cumsum([len(grid) for grid in grids])
        t = np.concatenate(grids)
        pose, twist = self._states(t)
        for values in (t, pose, twist):
            values.flags.writeable = False
        rows = [slice(a - 1, b) for a, b in pairwise(ends)]
        self._stamps, self._block, self._next = stamps, [(t[row], pose[row], twist[row]) for row in rows], 0

    def _foreseen(self, start_ns: int, end_ns: int, count: int) -> list[int]:
        """Gives the stamps of as many intervals as fit into a block; of this one alone where the next are unknown."""
        if self._rate is None:
            return [start_ns, end_ns]
        steps = 1 + (end_ns - start_ns) // self._timestep if self._inside else 1
        first, count = round(start_ns * self._rate / NS), max(min(count, self._fits // steps), 1)
        stamps = [keyframe_stamp(first + k, self._rate) for k in range(count + 1)]
        return stamps if stamps[:2] == [start_ns, end_ns] else [start_ns, end_ns]
