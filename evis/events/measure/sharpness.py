"""Measures the sharpness of events: how much of them falls together in few pixels.

Per window, the variance of the image of event counts over its mean (1 for events spread at random, more where they
gather): the objective of contrast maximisation (Gallego, Rebecq, Scaramuzza, CVPR 2018), with no warp or with one.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def dispersion(x: np.ndarray, y: np.ndarray, width: int, height: int) -> float:
    """Computes the variance over mean of the counts per pixel; x, y: [n] whole pixels inside the image."""
    n, pixels = len(x), width * height
    if not n:
        return float("nan")
    at = y.astype(np.int64) * width + x
    # by sorting where events are few: a whole image costs more than its events
    counts = np.unique(at, return_counts=True)[1] if n * 8 < pixels else np.bincount(at)
    mean = n / pixels
    return float(((counts.astype(np.float64) ** 2).sum() / pixels - mean**2) / mean)


class Sharpness:
    """Averages the windows' dispersion, weighted by their events."""

    def __init__(self, width: int, height: int) -> None:
        self._size = (width, height)
        self._sum = 0.0
        self._events = 0

    def add(self, x: np.ndarray, y: np.ndarray) -> None:
        """Adds the events of one window."""
        if len(x):
            self._sum += len(x) * dispersion(x, y, *self._size)
            self._events += len(x)

    def report(self) -> dict[str, Any]:
        """Reports the mean dispersion: variance of the count image over its mean, None without events."""
        return {"dispersion": self._sum / self._events if self._events else None}
