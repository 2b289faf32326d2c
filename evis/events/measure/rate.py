"""Measures the event rate of a stream: overall, ON and OFF, and over time, in one pass and bounded memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.events.time_histogram import TimeHistogram

MAX_BINS = 4096


class Rate:
    """Measures the rate of a stream over windows from the first event on; windows double once there are more than 4096.

    window_ns: length of a window at the start. Events earlier than the first one count in the first window.
    """

    def __init__(self, window_ns: int) -> None:
        self._histogram = TimeHistogram(MAX_BINS, window_ns, kinds=2)

    def add(self, t: np.ndarray, p: np.ndarray) -> None:
        """Counts events: t int64 [n, ns], p uint8 [n]."""
        self._histogram.add(t, p)

    def report(self) -> dict[str, Any]:
        """Reports rates in events per second; `series` holds [start of the window in ns, rate]."""
        histogram = self._histogram
        first, last, window = histogram.first_ns, histogram.last_ns, histogram.bin_ns
        off, on = (int(row.sum()) for row in histogram.rows)
        span = (last - (first or 0)) * 1e-9
        result: dict[str, Any] = {"events": on + off, "on": on, "off": off, "duration_s": span}
        if first is None or span <= 0:
            return result | {"event_rate_hz": None, "on_rate_hz": None, "off_rate_hz": None, "rate": None}
        both = histogram.rows.sum(0)[: int((last - first) // window) + 1]
        lengths = np.full(len(both), float(window))
        lengths[-1] = max(last - first - (len(both) - 1) * window, window / 4)
        values = both / lengths * 1e9
        starts = first + window * np.arange(len(both), dtype=np.int64)
        series = [[int(t), round(float(v), 3)] for t, v in zip(starts, values)]
        # The stream may end soon after its last window begins, whose rate then tells nothing; where there is no other
        # one, the rate over all of the stream does.
        ends_soon = last - first - (len(both) - 1) * window < window / 2
        whole = both / span if len(both) == 1 else values[:-1] if ends_soon else values
        spread = {"window_ns": window, "peak_hz": float(whole.max()), "median_hz": float(np.median(whole))}
        return result | {
            "event_rate_hz": (on + off) / span,
            "on_rate_hz": on / span,
            "off_rate_hz": off / span,
            "rate": spread | {"series": series},
        }
