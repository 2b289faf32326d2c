"""Event rate of a stream: overall, ON and OFF, and over time, in one pass and bounded memory."""

from __future__ import annotations

from typing import Any

import numpy as np

MAX_BINS = 4096


class Rate:
    """Counts events in equal windows from the first event on; windows double once there are more than 4096.

    window_ns: length of a window at the start. Events earlier than the first one count in the first window.
    """

    def __init__(self, window_ns: int) -> None:
        self.window_ns = window_ns
        self.first_ns: int | None = None
        self.last_ns = 0
        self._counts = np.zeros((2, MAX_BINS), np.int64)

    def add(self, t: np.ndarray, p: np.ndarray) -> None:
        """Count events: t int64 [n, ns], p uint8 [n]."""
        if not len(t):
            return
        if self.first_ns is None:
            self.first_ns = self.last_ns = int(t[0])
        self.last_ns = max(self.last_ns, int(t.max()))
        while self.last_ns - self.first_ns >= MAX_BINS * self.window_ns:
            halves = self._counts.reshape(2, -1, 2).sum(2)
            self._counts = np.concatenate([halves, np.zeros_like(halves)], 1)
            self.window_ns *= 2
        at = np.maximum(t - self.first_ns, 0) // self.window_ns
        for polarity in (0, 1):
            self._counts[polarity] += np.bincount(at[p == polarity], minlength=MAX_BINS)

    def report(self) -> dict[str, Any]:
        """Rates in events per second; `series` holds [start of the window in ns, rate]."""
        off, on = (int(row.sum()) for row in self._counts)
        span = (self.last_ns - (self.first_ns or 0)) * 1e-9
        result: dict[str, Any] = {"events": on + off, "on": on, "off": off, "duration_s": span}
        if self.first_ns is None or span <= 0:
            return result | {"event_rate_hz": None, "on_rate_hz": None, "off_rate_hz": None, "rate": None}
        both = self._counts.sum(0)[: int((self.last_ns - self.first_ns) // self.window_ns) + 1]
        lengths = np.full(len(both), float(self.window_ns))
        lengths[-1] = max(self.last_ns - self.first_ns - (len(both) - 1) * self.window_ns, self.window_ns / 4)
        values = both / lengths * 1e9
        starts = self.first_ns + self.window_ns * np.arange(len(both), dtype=np.int64)
        series = [[int(t), round(float(v), 3)] for t, v in zip(starts, values)]
        spread = {"window_ns": self.window_ns, "peak_hz": float(values.max()), "median_hz": float(np.median(values))}
        return result | {
            "event_rate_hz": (on + off) / span,
            "on_rate_hz": on / span,
            "off_rate_hz": off / span,
            "rate": spread | {"series": series},
        }
