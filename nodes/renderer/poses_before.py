"""Finds the poses at the keyframe before, which motion vectors begin from."""

from __future__ import annotations

from typing import Any

import numpy as np

from msgs.world import WorldState

LAST = "last"
"""In place of poses: those of the renderer's last call, which need not be compared with anything then."""


class PosesBefore:
    """Follows the states of a run, and tells of each the poses at the keyframe before it."""

    def __init__(self) -> None:
        """Starts before the first state of a run."""
        self.last: np.ndarray | None = None
        """What `take` gave last, or what LAST stood for, float64 [E, N, 7]."""
        self._present: np.ndarray | None = None
        self._stamp = 0
        self._episodes = np.zeros(0, np.int32)
        self._drawn = True

    def take(self, poses: np.ndarray, state: WorldState) -> np.ndarray | str:
        """Gives poses of the keyframe before a state, float64 [E, N, 7], or LAST; its own where an episode begins.

        A state of the last one's stamp is of environments that begin there; the others are as they were. poses: the
        state's `kept_end_pose`.
        """
        stamp, episodes = state.header.stamp_ns, state.episodes
        again = stamp == self._stamp
        previous = self.last if again else self._present
        before: np.ndarray | str = LAST
        if previous is None or self._present is None:
            before = previous = poses
        elif again or not np.array_equal(episodes, self._episodes):
            before = previous = np.where((episodes == self._episodes)[:, None, None], previous, poses)
        if not self._drawn:
            before, self._drawn = previous, True
        self.last, self._present, self._episodes, self._stamp = previous, poses, np.array(episodes), stamp
        return before

    def not_drawn(self) -> None:
        """Notes that the next keyframe is drawn by another renderer, which has not drawn the last one."""
        self._drawn = False

    def state(self) -> tuple[Any, ...]:
        """Gives the poses, stamp and episodes that the next `take` compares with."""
        return self._present, self.last, self._stamp, self._episodes

    def restore(self, state: tuple[Any, ...]) -> None:
        """Restores what `state` gave."""
        self._present, self.last, self._stamp, self._episodes = state
