"""Lays stretches of a stream whose times begin anew, as episodes of a bag do, one behind the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

STEP_BACK_NS = 100_000_000
"""Times that go back by more begin anew; by less, events are out of order."""
MOST = 10_000
"""Stretches that are told apart: times of a damaged file may go back with every event."""
_EARLIEST, _LATEST = np.iinfo(np.int64).min, np.iinfo(np.int64).max


class Stretches:
    """Gives events times that go on where those of a stream begin anew.

    step_ns: by how much times go back at least where they do. `begun_anew`: how often they did. `shift_ns`: by how much
    later than they are stored the times of the present stretch are given.
    """

    def __init__(self, step_ns: int = STEP_BACK_NS) -> None:
        self._step = step_ns
        self._before: int | None = None
        """Time of the last event, as stored."""
        self._latest = 0
        """The latest time that was given."""
        self.begun_anew = self.shift_ns = 0

    def parts(self, t: np.ndarray) -> Iterator[tuple[slice, np.ndarray, bool]]:
        """Yields the parts of a block that lie in one stretch each: which events, their times, whether they begin it.

        t: int64 [n] ns, in the stream's order. Times are int64 [m] ns; a stretch begins at the latest one before it.
        """
        if not len(t):
            return
        if self._before is None:
            self._before = self._latest = int(t[0])
        before = np.concatenate([np.array([self._before], np.int64), t[:-1]])
        self._before = int(t[-1])
        back = t < np.maximum(before, _EARLIEST + self._step) - self._step
        beginnings = set(np.flatnonzero(back)[: MOST - self.begun_anew].tolist())
        starts = sorted({0, *beginnings})
        for start, end in zip(starts, [*starts[1:], len(t)]):
            part = t[start:end]
            shift = self._latest - int(part[0])
            anew = start in beginnings and shift <= _LATEST  # what has no room stays where it is
            if anew:
                self.shift_ns = shift
                self.begun_anew += 1
            yield slice(start, end), self._moved(part), anew

    def _moved(self, t: np.ndarray) -> np.ndarray:
        moved = np.minimum(t, _LATEST - self.shift_ns) + self.shift_ns if self.shift_ns else t
        self._latest = max(self._latest, int(moved.max()))
        return moved
