"""Notices that an environment has come to rest, so that nothing need be computed until something is changed.

MuJoCo's contacts never end quite still: a box on the ground creeps at some 1e-11 m/s for ever.
"""

from __future__ import annotations

from collections import deque

STILL = 1e-8
"""Speed [m/s, rad/s] below which a body rests: 36 um in an hour."""
WINDOW_NS = 500_000_000
"""How long it must have been so [ns]."""
GROWTH = 1.01
"""Speeds that grow by this within half of that time are of something that is about to fall: in contacts they fade."""


class Rest:
    """Watches the speeds of the bodies of one environment, from interval to interval."""

    def __init__(self) -> None:
        self.now = False
        """Whether all rest."""
        self._seen: deque[tuple[int, float]] = deque()
        self._since = -1

    def wake(self) -> None:
        """Begins to watch anew, after something was changed."""
        self.now = False
        self._seen.clear()
        self._since = -1

    def see(self, start_ns: int, end_ns: int, fastest: float) -> None:
        """Notes the largest component of a velocity of a body over an interval [ns]."""
        if not fastest < STILL:
            self.wake()
            return
        self._since = start_ns if self._since < 0 else self._since
        self._seen.append((end_ns, fastest))
        # An interval may be longer than all that time: that before it is what the last one is compared with.
        while len(self._seen) > 2 and self._seen[0][0] < end_ns - WINDOW_NS:
            self._seen.popleft()
        if end_ns - self._since >= WINDOW_NS:
            halfway = end_ns - WINDOW_NS // 2
            early = max((speed for t, speed in self._seen if t <= halfway), default=0.0)
            late = max(speed for t, speed in self._seen if t > halfway)
            self.now = late <= GROWTH * early
