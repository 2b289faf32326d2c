"""Counts how the events of a stream spread over its time, in one pass and bounded memory."""

from __future__ import annotations

import numpy as np


class TimeHistogram:
    """Counts events in at most `bins` windows of equal length from the first event on; full, they double in length.

    bins: an even number. bin_ns: length of a window at the start. kinds: rows that are counted apart, as polarities.
    Events before the first one, as slightly disordered recordings have them, count in the first window.
    """

    def __init__(self, bins: int, bin_ns: int, kinds: int = 1) -> None:
        self.bins, self.bin_ns = bins, bin_ns
        self.first_ns: int | None = None
        self.last_ns = 0
        self.rows = np.zeros((kinds, bins), np.int64)
        """Events of each kind in each window."""

    def add(self, t: np.ndarray, kind: np.ndarray | None = None) -> None:
        """Counts events at t, int64 [n] ns. kind: [n], the row of each; all are in the first row by default."""
        if not len(t):
            return
        if self.first_ns is None:
            self.first_ns = self.last_ns = int(t[0])
        self.last_ns = max(self.last_ns, int(t.max()))
        while self.last_ns - self.first_ns >= self.bins * self.bin_ns:
            halves = self.rows.reshape(len(self.rows), -1, 2).sum(2)
            self.rows = np.concatenate([halves, np.zeros_like(halves)], 1)
            self.bin_ns *= 2
        # unsigned, because the distance of two int64 can be larger than int64
        since = np.maximum(t, self.first_ns).view(np.uint64) - np.asarray(self.first_ns, np.int64).view(np.uint64)
        at = (since // np.uint64(self.bin_ns)).astype(np.int64)
        for row, counts in enumerate(self.rows):
            counts += np.bincount(at if kind is None else at[kind == row], minlength=self.bins)

    def counts(self) -> list[int]:
        """Returns the events of each window, all kinds together, up to the last window that has any."""
        both = self.rows.sum(0)
        filled = np.flatnonzero(both)
        return both[: filled[-1] + 1].tolist() if len(filled) else []
