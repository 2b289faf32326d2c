"""Keeps the gap before the one that is made, by which the motion of its end is to be measured."""

from __future__ import annotations

import numpy as np

from nodes.interpolator.keyframe import KeyframeView


class GapBefore:
    """Remembers of each gap how long it was, for the next one, which begins where it ends."""

    def __init__(self, envs: int) -> None:
        """Begins without a gap. envs: E."""
        self._last: KeyframeView | None = None
        self._gap = np.ones(envs, np.int64)
        self._first = np.ones(envs, bool)

    def of(self, a: KeyframeView, b: KeyframeView, held: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the lengths of the gap before A and of that from A to B, int64 [E] ns, and which environments had
        none before, bool [E], whose first is as long as the second.

        It is called once for every gap. Gaps whose lengths differ by a nanosecond are equal: stamps are rounded.
        """
        envs = len(held)
        known = a is self._last or (a.replaces is not None and a.replaces is self._last)
        # A keyframe that did not end a gap began an episode.
        first = self._first if known else np.ones(envs, bool)
        if a.begun is not None:
            first = first | a.begun
        gap = np.where(held, 1, b.times(envs) - a.times(envs))
        before = np.where(first | (abs(self._gap - gap) <= 1), gap, self._gap)
        self._last, self._gap, self._first = b, gap, held
        return before, gap, first
