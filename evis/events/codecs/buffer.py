"""Holds the arrays that decoders append events to, so that one packet is written once and in place."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from evis.events.arrays import Events

Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""t int64 [ns], x uint16, y uint16, p uint8, all of shape [n]."""
Allocate = Callable[[int], Columns]
"""Columns for so many events; their contents do not matter."""


def plain(n: int) -> Columns:
    """Makes event columns in memory of their own."""
    return np.empty(n, np.int64), np.empty(n, np.uint16), np.empty(n, np.uint16), np.empty(n, np.uint8)


class EventBuffer:
    """Holds events in the first `n` places of `columns`. allocate: where larger columns come from."""

    LEAST = 64
    """More than any one word of a sensor holds: a buffer with so much room lets every decoder go on [events]."""

    def __init__(self, capacity: int, allocate: Allocate = plain) -> None:
        self._allocate = allocate
        self.n = 0
        self._use(allocate(max(capacity, self.LEAST)))

    def _use(self, columns: Columns) -> None:
        self.columns = columns
        self.capacity = len(columns[0])
        self.places = [(c.__array_interface__["data"][0], c.itemsize) for c in columns]
        """Address of the first item and size of an item [bytes], by column."""

    def grow(self, room: int = 0) -> None:
        """Doubles the buffer, or enlarges it to hold `room` more events; what it holds is copied."""
        filled = self.events()
        self._use(self._allocate(max(2 * self.capacity, self.n + room)))
        for new, old in zip(self.columns, (filled.t, filled.x, filled.y, filled.p)):
            new[: self.n] = old

    def append(self, events: Events) -> None:
        """Adds events by copying."""
        end = self.n + len(events)
        if end > self.capacity:
            self.grow(len(events))
        for column, new in zip(self.columns, (events.t, events.x, events.y, events.p)):
            column[self.n : end] = new
        self.n = end

    def events(self, start: int = 0) -> Events:
        """Returns the events from `start` on, as views."""
        t, x, y, p = self.columns
        part = slice(start, self.n)
        return Events(t[part], x[part], y[part], p[part])
