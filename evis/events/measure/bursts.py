"""Finds bursts: runs of events of one pixel and one polarity, as an edge makes them that passes over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GAP_NS = 30_000_000
"""Longest interval inside a burst."""
LEAST = 3
"""Events that make a burst; fewer may be noise."""


@dataclass(frozen=True)
class Bursts:
    """Holds the bursts of a recording, by pixel and time.

    pixel int64 [B], p uint8 [B] of each; start, length int64 [B, ns]: from its first to its last event; count int64
    [B]: its events. interval int64 [I, ns], interval_p uint8 [I]: between neighbouring events inside of bursts.
    """

    pixel: np.ndarray
    p: np.ndarray
    start: np.ndarray
    length: np.ndarray
    count: np.ndarray
    interval: np.ndarray
    interval_p: np.ndarray


def bursts_of(t: np.ndarray, pixel: np.ndarray, p: np.ndarray) -> Bursts:
    """Finds the bursts of a stream.

    t: int64 [n, ns], ascending. pixel: integers [n], any number that names the pixel of each event. p: [n], 1 = ON.
    """
    order = np.argsort(pixel, kind="stable")
    t, pixel, p = t[order], pixel[order], p[order]
    goes_on = np.zeros(len(t), bool)
    goes_on[1:] = (pixel[1:] == pixel[:-1]) & (p[1:] == p[:-1]) & (np.diff(t) <= GAP_NS)
    first = np.flatnonzero(~goes_on)
    count = np.diff(np.append(first, len(t)))
    inside = goes_on & np.repeat(count >= LEAST, count)
    at = np.flatnonzero(inside)
    first, count = first[count >= LEAST], count[count >= LEAST]
    return Bursts(
        pixel=pixel[first].astype(np.int64),
        p=p[first],
        start=t[first],
        length=t[first + count - 1] - t[first],
        count=count,
        interval=t[at] - t[at - 1],
        interval_p=p[at],
    )
