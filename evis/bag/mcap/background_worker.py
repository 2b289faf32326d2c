"""Runs work in a background thread, one piece after another, as the writing of large chunks."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

Work = Callable[[], None]

MAX_BYTES = 64 << 20
"""Bytes that may wait; whoever has more waits."""


class BackgroundWorker:
    """Runs work in the order in which it was added, in a thread that starts with the first.

    name: of the thread. most: bytes that may wait, MAX_BYTES where it is not given. error: what the first work that
    failed has raised, after which nothing more is done.
    """

    def __init__(self, name: str = "bag-write", most: int | None = None) -> None:
        self._name, self._most = name, most
        self._waiting: deque[tuple[Work, int]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._over = False
        self.error: Exception | None = None

    def put(self, work: Work, size: int) -> None:
        """Adds work that holds `size` bytes; waits while too much is held. Raises OSError where no thread can start."""
        most = MAX_BYTES if self._most is None else self._most
        with self._changed:
            self._start()
            self._changed.wait_for(lambda: self.error or not self._waiting or self._bytes + size <= most)
            self._waiting.append((work, size))
            self._bytes += size
            self._changed.notify_all()

    def _start(self) -> None:
        if self._thread is not None:
            return
        thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        try:
            thread.start()
        except RuntimeError as error:
            # Work that nobody does would be waited for without end.
            remedy = "raise the limits (ulimit -u, ulimit -v) or free memory"
            raise OSError(f"the thread {self._name} cannot start ({error}); {remedy}") from None
        self._thread = thread

    @property
    def unfinished(self) -> int:
        """Returns the number of pieces of work that are not finished: those added last."""
        return len(self._waiting)

    def wait(self) -> None:
        """Waits until all work is finished, or one piece has failed."""
        self.wait_below(1)

    def wait_below(self, count: int) -> None:
        """Waits until fewer than `count` pieces of work are unfinished, or one has failed."""
        if self._thread is not None:
            with self._changed:
                self._changed.wait_for(lambda: self.error or len(self._waiting) < count)

    def close(self) -> None:
        """Ends the thread after its present piece of work. A second call does nothing."""
        with self._changed:
            self._over = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._over or self._waiting)
                if self._over or self.error:
                    return
                work, size = self._waiting[0]
            error = None
            try:
                work()
            except Exception as failed:
                error = failed
            with self._changed:
                self.error = error
                if error is None:
                    self._waiting.popleft()
                    self._bytes -= size
                self._changed.notify_all()
