"""Threads that share the work on one message of a bag."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST_THREADS = 8
"""More of them wait for the file, which one thread writes."""


class Threads:
    """Does a piece of work on several items at once, and waits for all of them.

    count: how many at once; 1 = by the caller, one after the other; None = one per core that the process may use, at
    most MOST_THREADS. Threads start when there is work for them.
    """

    def __init__(self, count: int | None = None) -> None:
        self.count = min(MOST_THREADS, len(os.sched_getaffinity(0))) if count is None else count
        self._pool = ThreadPoolExecutor(self.count, "bag-work") if self.count > 1 else None

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """Returns what `work` gives for each item, in their order. Raises what it raises, when all of it is over."""
        given = list(items)
        if self._pool is None or len(given) < 2:
            return [work(item) for item in given]
        mine, *others = given
        under_way = [self._pool.submit(work, item) for item in others]
        try:
            return [work(mine), *(each.result() for each in under_way)]
        finally:
            wait(under_way)  # what they work on is the caller's again

    def begin(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Callable[[], list[Result]]:
        """Begins as `map` does, and returns a function that waits for the results."""
        if self._pool is None:
            given = list(items)
            return lambda: [work(item) for item in given]
        results = self._pool.map(work, items)
        return lambda: list(results)

    def close(self) -> None:
        """Ends the threads. A second call does nothing."""
        if self._pool is not None:
            self._pool.shutdown()


ALONE = Threads(1)
"""The caller's own thread."""
