"""Hands what a server's thread counts and reports to the node, which may speak on its own thread only."""

from __future__ import annotations

import threading
import time
from collections import Counter

REPORTS, REPORTS_S = 10, 60.0
"""Most lines that the node is to say, and the same line at most once, in so many seconds."""


class Notices:
    """Collects counts and lines; every method is safe from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._reports: list[str] = []
        self._reported: dict[str, float] = {}
        self._counts: Counter[str] = Counter()

    def report(self, text: str) -> None:
        """Takes something that the node is to warn about, unless it has just done so, or has said much already."""
        now = time.monotonic()
        with self._lock:
            self._reported = {line: at for line, at in self._reported.items() if now - at < REPORTS_S}
            if text in self._reported:
                return
            if len(self._reported) >= REPORTS:
                self._counts["warnings_left_out"] += 1
                return
            self._reported[text] = now
            self._reports.append(text)

    def count(self, name: str, amount: int = 1) -> None:
        """Adds to a counter of the node."""
        with self._lock:
            self._counts[name] += amount

    def counts(self) -> Counter[str]:
        """Returns what was counted since the last call."""
        with self._lock:
            new, self._counts = self._counts, Counter()
        return new

    def reports(self) -> list[str]:
        """Returns the reports since the last call that are new."""
        with self._lock:
            new, self._reports = self._reports, []
        return new
