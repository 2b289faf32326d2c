"""One small recording whose written forms other libraries have read back (`test_recording_written`)."""

from __future__ import annotations

import numpy as np

from evis.events import Events, Triggers


def golden_events() -> Events:
    """200 events of a formula, times in whole us and going up, and three trigger edges."""
    i = np.arange(200, dtype=np.int64)
    t = np.cumsum(i * i * 7 % 53) * 1000 + 5_000_000
    events = Events.of(t, i * 37 % 320, i * 11 % 240, i * i // 3 % 2)
    edges = np.array([5_000_000, 6_000_000, 7_000_000], np.int64)
    events.triggers = Triggers(edges, np.zeros(3, np.uint8), np.array([1, 0, 1], np.uint8))
    return events
