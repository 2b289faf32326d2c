"""Counts the signals that ask a run to end, so that its supervisor can end it in order."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
from collections.abc import Iterator
from types import FrameType

ONCE_S = 0.02
"""What asks twice within this asks once: a terminal sends Ctrl-C to a program and to who started it, which hands it on,
and `timeout` sends SIGTERM to a program and then to its group [s]."""


class Interrupts:
    """Counts Ctrl-C, SIGTERM and a lost terminal (except under nohup), in place of raising.

    most: how many are counted; one more raises KeyboardInterrupt, for who may hang and has nobody to end it. None: all.
    """

    def __init__(self, most: int | None = None) -> None:
        self.count = 0
        self._most = most
        self._counted_at = -math.inf

    @contextlib.contextmanager
    def counted(self) -> Iterator[None]:
        """Counts the signals within the block; outside the main thread, which alone gets them, it does nothing."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        numbers = [signal.SIGINT, signal.SIGTERM]
        if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
            numbers.append(signal.SIGHUP)
        before = {number: signal.signal(number, self._one_more) for number in numbers}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _one_more(self, number: int, frame: FrameType | None) -> None:
        if time.monotonic() - self._counted_at < ONCE_S:
            return
        self._counted_at = time.monotonic()
        self.count += 1
        if self._most is not None and self.count > self._most:
            raise KeyboardInterrupt(number)
