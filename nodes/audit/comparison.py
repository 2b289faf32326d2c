"""Measures the distance between the events of two runs of the same pixels, pixel by pixel, as they come."""

from __future__ import annotations

import numpy as np
import warp as wp

from evis.events.measure.distance_kernels import victor_purpura_kernel
from evis.gpu.exchange import as_warp
from nodes.audit.events_kernels import count_unpaired

Q_PER_MS = 1.0
"""Cost of moving an event by 1 ms in the Victor-Purpura distance; adding or leaving one out costs 1."""

WITHIN_NS = 1_000_000
"""Time within which an event's partner must lie."""

APART_NS = round(2e6 / Q_PER_MS)
"""Time from which on moving an event costs no less than leaving it out and adding it."""

LONGEST = 2048
"""Events of a pixel and polarity without such a pause that are worked on together."""

Train = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Events (pixel int64, t int64 ns, p uint8)."""


class Comparison:
    """Adds up distances of N pixels: `vp`, float64 [N], `unpaired` and `events`, int64 [N], of both runs.

    No event is moved over a pause of APART_NS in both runs, so that what lies between two pauses is worked on by
    itself: the sums are exact, and the work does not grow with the length of a run.
    """

    def __init__(self, pixels: int) -> None:
        self.vp = np.zeros(pixels)
        self.unpaired, self.events = np.zeros(pixels, np.int64), np.zeros(pixels, np.int64)
        self._open = [(np.zeros(0, np.int64), np.zeros(0, np.int64)) for _ in range(2)]

    def add(self, run: Train, truth: Train, until_ns: int) -> None:
        """Takes the next events of both, each complete up to `until_ns`."""
        for k, (pixel, t, p) in enumerate((run, truth)):
            self.events += np.bincount(pixel, minlength=len(self.vp))
            groups, times = self._open[k]
            self._open[k] = np.concatenate([groups, pixel * 2 + p]), np.concatenate([times, t])
        self._close(until_ns)

    def finish(self, which: np.ndarray) -> None:
        """Compares all that is left of pixels bool [N], at the end of their episode."""
        self._close(None, which)

    def clear(self, which: np.ndarray) -> None:
        """Begins the sums of pixels bool [N] at 0 again."""
        self.vp[which], self.unpaired[which], self.events[which] = 0, 0, 0

    def _close(self, until_ns: int | None, ending: np.ndarray | None = None) -> None:
        group = np.concatenate([g for g, _ in self._open])
        t = np.concatenate([t for _, t in self._open])
        truth = np.repeat([0, 1], [len(self._open[0][0]), len(self._open[1][0])])
        if not len(t):
            return
        order = np.lexsort((t, group))
        group, t, truth = group[order], t[order], truth[order]
        begins = np.ones(len(t), bool)
        begins[1:] = (np.diff(group) != 0) | (np.diff(t) >= APART_NS)
        cluster = np.cumsum(begins) - 1
        ends = np.append(begins[1:], True)
        if ending is not None:
            done = ending[group[ends] // 2]
        else:
            assert until_ns is not None
            done = (t[ends] <= until_ns - APART_NS) | (np.bincount(cluster) > LONGEST)
        closed = done[cluster]
        self._work(group[closed], t[closed], truth[closed], begins[closed])
        kept = ~closed
        self._open = [(group[kept & (truth == k)], t[kept & (truth == k)]) for k in range(2)]

    def _work(self, group: np.ndarray, t: np.ndarray, truth: np.ndarray, begins: np.ndarray) -> None:
        """The distances of clusters, of events by cluster and time."""
        cluster = np.cumsum(begins) - 1
        count = int(begins.sum())
        if not count:
            return
        trains: list[np.ndarray] = []
        for k in range(2):
            mine = truth == k
            sizes = np.bincount(cluster[mine], minlength=count)
            trains += [t[mine], np.concatenate([[0], np.cumsum(sizes)])]
        distance, unpaired = np.zeros(count), np.zeros(count, np.int64)
        row = np.zeros(len(trains[2]) + count)
        shared = [as_warp(a) for a in trains]
        out = [as_warp(distance), as_warp(unpaired)]
        wp.launch(victor_purpura_kernel, count, [*shared, Q_PER_MS * 1e-6, as_warp(row)], [out[0]], device="cpu")
        wp.launch(count_unpaired, count, [*shared, WITHIN_NS], [out[1]], device="cpu")
        pixel = group[begins] // 2
        np.add.at(self.vp, pixel, distance)
        np.add.at(self.unpaired, pixel, unpaired)
