"""Builds DSEC's index of events by the millisecond: ms_to_idx[ms] is the first event at or after that millisecond.

Its definition is that of uzh-rpg/DSEC, scripts/utils/eventslicer.py.
"""

from __future__ import annotations

import numpy as np

NAME = "ms_to_idx"
_MS = 1_000_000


class MillisecondIndex:
    """Makes the index of events that come in order of time: t[idx[ms]] >= ms > t[idx[ms] - 1], from `start_ns` on."""

    def __init__(self, start_ns: int) -> None:
        self._start, self._next, self._events = start_ns, 0, 0

    def add(self, t: np.ndarray) -> np.ndarray:
        """Takes further events, int64 [n] ns ascending; returns the entries that are known now, uint64."""
        if not len(t):
            return np.empty(0, np.uint64)
        last = (int(t[-1]) - self._start) // _MS
        marks = np.arange(self._next, last + 1, dtype=np.int64)
        entries = self._events + np.searchsorted(t, self._start + marks * _MS)
        self._next, self._events = max(self._next, last + 1), self._events + len(t)
        return entries.astype(np.uint64)

    def finish(self, end_ns: int) -> np.ndarray:
        """Returns the entries up to the first millisecond that is not before the end, and after the last event."""
        end = max(-((self._start - end_ns) // _MS), self._next)
        entries = np.full(end + 1 - self._next, self._events, np.uint64)
        self._next = end + 1
        return entries
