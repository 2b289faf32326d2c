"""Shares the work on one message of a bag among threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import count
from typing import Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST_THREADS = 8
"""More of them wait for the file, which one thread writes."""


class Threads:
    """Runs a function on several items at once, and waits for all results.

    count: how many at once; 1 = by the caller, one after the other; None = one per core that the process may use, at
    most MOST_THREADS. Threads start when there is work for them.
    """

    def __init__(self, count: int | None = None) -> None:
        self.count = min(MOST_THREADS, len(os.sched_getaffinity(0))) if count is None else count
        self._pool = ThreadPoolExecutor(self.count, "bag-work") if self.count > 1 else None

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """Returns what `work` gives for each item, in order; raises the error of the first item that has one.

        The caller works as well, so that it waits for no thread that has something else to do.
        """
        given = list(items)
        if self._pool is None or len(given) < 2:
            return [work(item) for item in given]
        shared = _Shared(work, given)
        helpers = [self._pool.submit(shared.take) for _ in range(min(self.count, len(given) - 1))]
        shared.take()
        wait([helper for helper in helpers if not helper.cancel()])
        return shared.found()

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


class _Shared(Generic[Item, Result]):
    """Gives out items in order to the threads that ask for one, until one fails."""

    def __init__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> None:
        self._work, self._items, self._next = work, items, count()
        self._results: dict[int, Result] = {}
        self._errors: dict[int, BaseException] = {}

    def take(self) -> None:
        """Works on items until none is left."""
        while not self._errors and (k := next(self._next)) < len(self._items):
            try:
                self._results[k] = self._work(self._items[k])
            except BaseException as error:
                self._errors[k] = error

    def found(self) -> list[Result]:
        """Returns the results. Raises the error of the first item that has one: those before it were all taken."""
        if self._errors:
            raise self._errors[min(self._errors)]
        return [self._results[k] for k in range(len(self._items))]


ALONE = Threads(1)
"""The caller's own thread."""
