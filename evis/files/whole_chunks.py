"""Keeps rows until a chunk of a compressed array is full, so that none is compressed twice."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_MANY = 64


class WholeChunks:
    """Hands rows on in whole chunks; less than one chunk is in memory between calls."""

    def __init__(self, sink: Callable[[np.ndarray], None], rows: int) -> None:
        self._sink, self._rows = sink, rows
        self._waiting: list[np.ndarray] = []
        self._count = 0

    def add(self, rows: np.ndarray) -> None:
        """Takes rows [n, ...], and hands on what makes whole chunks."""
        self._waiting.append(rows)
        self._count += len(rows)
        if len(self._waiting) >= _MANY:  # a row of 8 bytes costs a hundred as an array of its own
            self._waiting = [np.concatenate(self._waiting)]
        whole = self._count // self._rows * self._rows
        if whole:
            held = np.concatenate(self._waiting)
            self._sink(held[:whole])
            self._waiting, self._count = [held[whole:].copy()], self._count - whole

    def flush(self) -> None:
        """Writes the rows that are left, which are less than a chunk."""
        if self._count:
            self._sink(np.concatenate(self._waiting))
        self._waiting, self._count = [], 0
