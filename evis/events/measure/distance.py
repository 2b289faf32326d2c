"""Measures how far one event stream is from another: counts, spike trains, event frames.

Streams are (t int64 ns, x, y, p) arrays, sorted by t. All errors are 0 for equal streams.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

CELLS_AT_ONCE = 1 << 22
"""Pixels of event frames that are held at a time."""


@dataclass(frozen=True)
class EventStream:
    """Holds the events of one sensor: t int64 [n] ns, x and y uint16 [n], p uint8 [n] (1 = ON)."""

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    width: int
    height: int

    def trains(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the times grouped by pixel and polarity, and offsets int64 [2 H W + 1] of the groups ((y W + x) 2 +
        p).
        """
        return self._trains

    @cached_property
    def _trains(self) -> tuple[np.ndarray, np.ndarray]:
        group = (self.y.astype(np.int64) * self.width + self.x) * 2 + self.p
        order = np.lexsort((self.t, group))
        counts = np.bincount(group, minlength=2 * self.width * self.height)
        return self.t[order], np.concatenate([[0], np.cumsum(counts)])


def count_error(test: EventStream, reference: EventStream) -> float:
    """Computes the sum over pixels and polarities of |n_test - n_ref|, over the number of reference events."""
    a, b = np.diff(test.trains()[1]), np.diff(reference.trains()[1])
    return float(np.abs(a - b).sum() / max(len(reference.t), 1))


def victor_purpura(test: EventStream, reference: EventStream, q_per_ms: float) -> float:
    """Computes the Victor-Purpura distance summed over pixels and polarities, over the number of events of both
    (0 to 1).

    Edit distance between spike trains: an insertion or deletion costs 1, a shift q |dt| (Victor and Purpura, "Nature
    and precision of temporal coding in visual cortex", 1996).
    """
    import warp as wp

    from evis.events.measure.distance_kernels import victor_purpura_kernel

    (ta, offsets_a), (tb, offsets_b) = test.trains(), reference.trains()
    total = len(ta) + len(tb)
    if not total:
        return 0.0
    groups = len(offsets_a) - 1
    distance = wp.zeros(groups, dtype=wp.float64, device="cpu")
    row = wp.zeros(len(tb) + groups, dtype=wp.float64, device="cpu")
    both: tuple[np.ndarray, ...] = (ta, offsets_a, tb, offsets_b)
    arrays: list[wp.array] = [wp.array(np.ascontiguousarray(a), dtype=wp.int64, device="cpu") for a in both]
    inputs = [*arrays, q_per_ms * 1e-6, row]
    wp.launch(victor_purpura_kernel, dim=groups, inputs=inputs, outputs=[distance], device="cpu")
    return float(distance.numpy().sum() / total)


def event_frame_error(test: EventStream, reference: EventStream, bin_ns: int = 1_000_000) -> float:
    """Computes the norm of the difference of signed event frames of bin_ns, over the norm of the reference's."""
    start = min((int(s.t[0]) for s in (test, reference) if len(s.t)), default=0)
    size = reference.height * reference.width
    cells, signs = zip(*(_cells(s, start, bin_ns) for s in (test, reference)))
    last = max((int(c[-1]) for c in cells if len(c)), default=-1) // size
    difference = norm = 0.0
    per_turn = max(1, CELLS_AT_ONCE // size)
    for first in range(0, last + 1, per_turn):
        # Events are sorted by time, and with it by event frame.
        frames = []
        for cell, sign in zip(cells, signs):
            part = slice(*np.searchsorted(cell // size, (first, first + per_turn)))
            frames.append(np.bincount(cell[part] - first * size, sign[part], minlength=per_turn * size))
        difference += float(np.sum((frames[0] - frames[1]) ** 2))
        norm += float(np.sum(frames[1] ** 2))
    return float(np.sqrt(difference / norm)) if norm else float(difference > 0)


def _cells(s: EventStream, start: int, bin_ns: int) -> tuple[np.ndarray, np.ndarray]:
    """Computes the index of the event frame, then of the pixel, of each event, int64, and its sign."""
    return ((s.t - start) // bin_ns * s.height + s.y) * s.width + s.x, np.where(s.p, 1.0, -1.0)


def time_error(test: EventStream, reference: EventStream) -> tuple[float, float]:
    """Computes the median and 90 % quantile of the time from a reference event to the nearest of its pixel and polarity
    [us].

    Reference events whose pixel has none in the test stream do not count here; count_error shows them.
    """
    (ta, offsets_a), (tb, offsets_b) = test.trains(), reference.trains()
    group_b = np.repeat(np.arange(len(offsets_b) - 1), np.diff(offsets_b))
    low, high = offsets_a[group_b], offsets_a[group_b + 1]
    some = high > low
    group_b, tb, low, high = group_b[some], tb[some], low[some], high[some]
    if not len(tb):
        return 0.0, 0.0
    # One sorted axis for all groups: a group's times are shifted beyond those of the group before. Of the times their
    # ranks, since a span in ns times the groups of a large sensor is more than an int64 holds after an hour and a half.
    times = np.unique(np.concatenate([ta, tb]))
    group_a = np.repeat(np.arange(len(offsets_a) - 1), np.diff(offsets_a))
    rank_a, rank_b = (np.searchsorted(times, t) for t in (ta, tb))
    at = np.searchsorted(rank_a + group_a * len(times), rank_b + group_b * len(times))
    after = np.abs(ta[np.minimum(at, high - 1)] - tb)
    before = np.abs(ta[np.maximum(at - 1, low)] - tb)
    error = np.minimum(after, before) / 1e3
    return float(np.quantile(error, 0.5)), float(np.quantile(error, 0.9))


def log_error(frames: np.ndarray, reference: np.ndarray, threshold: float) -> float:
    """Computes the root mean square of ln I - ln I_ref over the pixels of both where the reference is lit, in
    thresholds.

    frames and reference: linear luminance of one shape. A pixel that is dark (0, negative, not finite) in the frames
    alone has no finite error and makes the whole not finite.
    """
    lit = (reference > 0) & np.isfinite(reference)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.log(frames[lit].astype(np.float64)) - np.log(reference[lit].astype(np.float64))
    return float(np.sqrt(np.mean(error**2)) / threshold) if error.size else 0.0
