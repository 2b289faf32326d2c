"""Feeds an emulated camera with prepared bytes at a steady rate, to measure how much a driver can take."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from nodes.camera.emulated.feed import Feed

PIECE = 1 << 20
"""Bytes that a read may give where the current turn has ended and the next has not begun."""


class FloodFeed(Feed):
    """Supplies prepared bytes again and again at a steady rate [bytes/s], as a sensor that waits for nobody.

    repeat(turn) gives the bytes of one turn, so that their times can go on. fifo: bytes that the camera itself can hold
    while nobody reads; what does not fit is lost in the camera and counted in `lost`. `offered` counts all bytes, those
    that were lost too.
    """

    def __init__(self, turns: Iterator[np.ndarray], rate: float, fifo: int = 1 << 20, seconds: float = 0.0) -> None:
        super().__init__()
        self._turns, self._rate, self._fifo, self._seconds = turns, rate, fifo, seconds
        self._current = next(turns)
        self._at = 0
        self._began = 0.0
        self._taken = 0
        self.lost = 0
        self.offered = 0

    def read(self, size: int, timeout_s: float) -> bytes | memoryview:
        now = time.monotonic()
        if not self._began:
            self._began = now
        if self._seconds and now - self._began > self._seconds:
            raise EOFError
        wanted = min(size, self._fifo)
        ready = int((now - self._began) * self._rate) - self._taken
        if ready < wanted:
            time.sleep(min((wanted - ready) / self._rate, timeout_s))
            ready = int((time.monotonic() - self._began) * self._rate) - self._taken
        over = max(ready - self._fifo, 0)
        if over:
            over &= ~1
            self.lost += over
            self._skip(over)
        size = min(size, self._fifo, ready - over, len(self._current) - self._at or PIECE)
        if self._at == len(self._current):
            self._current, self._at = next(self._turns), 0
            size = min(size, len(self._current))
        part = self._current[self._at : self._at + size]
        self._at += size
        self._taken += size
        self.offered = self._taken
        return part.data

    def _skip(self, count: int) -> None:
        """Skips bytes that were lost in the camera."""
        self._taken += count
        while count:
            if self._at == len(self._current):
                self._current, self._at = next(self._turns), 0
            step = min(count, len(self._current) - self._at)
            self._at += step
            count -= step
