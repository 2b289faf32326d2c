"""Obeys SIGTERM at a place where nothing is half done, and after a moment wherever the process is."""

from __future__ import annotations

import signal
from types import FrameType

GRACE_S = 0.5
"""How long a process may take to come to such a place [s]; less than its supervisor waits before it has begun."""
STATUS = 128 + signal.SIGTERM
"""Exit status of a process that was told to end: 143."""


class Termination:
    """Turns SIGTERM into SystemExit, once, so that nodes close their files.

    An exception between any two steps would leave messages released but not forgotten, or half a record in a file, and
    what then fails would be told as the cause. So it is raised by `check`, which the loops of a process call; what does
    not come there (a long step, a wait in native code) is ended by a timer. `asked`: the signal has come, and what
    fails from here on is a consequence.
    """

    def __init__(self) -> None:
        self.asked = False
        self._over = False
        signal.signal(signal.SIGALRM, self._late)
        signal.signal(signal.SIGTERM, self._ask)

    def check(self) -> None:
        """Raises SystemExit if the signal has come: nothing is half done here."""
        if self.asked and not self._over:
            self._over = True
            signal.setitimer(signal.ITIMER_REAL, 0)
            raise SystemExit(STATUS)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if not self.asked:
            self.asked = True
            signal.setitimer(signal.ITIMER_REAL, GRACE_S)

    def _late(self, number: int, frame: FrameType | None) -> None:
        self.check()
