"""Counts how the events of a recording spread over its time, in one pass and bounded memory."""

from __future__ import annotations

import numpy as np

BINS = 64
FIRST_BIN_NS = 1000


class RateHistogram:
    """Counts events in at most 64 bins of equal length from the first event on; bins double as time goes on.

    Events before the first one, as slightly disordered recordings have them, count in the first bin.
    """

    def __init__(self) -> None:
        self.bin_ns = FIRST_BIN_NS
        self._counts = np.zeros(BINS, np.int64)
        self._first: np.int64 | None = None

    def add(self, t: np.ndarray) -> None:
        """Counts events at t, int64 [n] ns."""
        if not len(t):
            return
        if self._first is None:
            self._first = np.int64(t[0])
        # unsigned, because the distance of two int64 can be larger than int64
        since = np.maximum(t, self._first).view(np.uint64) - np.asarray(self._first).view(np.uint64)
        longest = int(since.max())
        while longest >= BINS * self.bin_ns:
            self._counts = np.append(self._counts.reshape(-1, 2).sum(1), np.zeros(BINS // 2, np.int64))
            self.bin_ns *= 2
        self._counts += np.bincount((since // np.uint64(self.bin_ns)).astype(np.int64), minlength=BINS)

    def counts(self) -> list[int]:
        """Returns the events of each bin, up to the last one that has any."""
        filled = np.flatnonzero(self._counts)
        return self._counts[: filled[-1] + 1].tolist() if len(filled) else []
