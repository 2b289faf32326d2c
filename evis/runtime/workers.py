"""Runs threads that compute for a node, charges their CPU time to the thread that gives them work, and cuts that into
shares."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")


class _Ledger(threading.local):
    """Holds the CPU time [s] of the work that a thread gave away: of each call not added up yet, and of all others."""

    def __init__(self) -> None:
        self.fresh: deque[float] = deque()
        self.total = 0.0


_ledger = _Ledger()


class Workers(ThreadPoolExecutor):
    """Runs calls in threads as a ThreadPoolExecutor does, and charges their CPU time to the thread that
    submitted them."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Schedules a call; see `spent_by_workers`."""
        # Appending is atomic, adding to a number is not. What has ended is added up here too, for who keeps no profile
        # never asks, and the list must not grow.
        spent_by_workers()
        fresh = _ledger.fresh

        def timed() -> T:
            before = time.thread_time()
            try:
                return fn(*args, **kwargs)
            finally:
                fresh.append(time.thread_time() - before)

        return super().submit(timed)


def edges_of(count: int, parts: int) -> list[int]:
    """Gives where each of `parts` shares of `count` things begins, and the end of the last: sizes differ by one at
    most."""
    return [count * k // parts for k in range(parts + 1)]


def spent_by_workers() -> float:
    """Returns the CPU time [s] of all finished calls that this thread has submitted to `Workers`."""
    while _ledger.fresh:
        _ledger.total += _ledger.fresh.popleft()
    return _ledger.total
