"""Adds up the device time of a stream whose clock starts anew when the camera is plugged in again."""

from __future__ import annotations


class Elapsed:
    """Measures how long a camera has streamed by its own clock, without the time in which it was unplugged."""

    def __init__(self) -> None:
        self._before = self._begun = self._now = 0
        self._episode: int | None = None

    @property
    def ns(self) -> int:
        """Returns the device time of all connections so far [ns]."""
        return self._before + self._now - self._begun

    def add(self, episode: int, t0_ns: int, stamp_ns: int) -> int:
        """Adds a reading (t0_ns, stamp_ns] of connection number `episode`, and returns the time so far [ns]."""
        if episode != self._episode:
            self._before, self._begun, self._episode = self.ns, t0_ns, episode  # of the connection before
        self._now = stamp_ns
        return self.ns
