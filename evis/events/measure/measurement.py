"""Measures a stream of events in one pass: rate, noise, sharpness, rotation. Memory does not grow with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from evis.events.measure.noise import Noise
from evis.events.measure.rate import Rate
from evis.events.measure.rotation.merge import merge
from evis.events.measure.rotation.rotation import TOO_FEW, measure_rotation
from evis.events.measure.sharpness import Sharpness
from evis.events.pixel_limit import check_pixels
from evis.events.stretches import STEP_BACK_NS, Stretches

SEGMENT_NS = 2_000_000_000
"""Rotation is measured stretch by stretch."""
THIN_NS = 1_000_000
THIN_EVENTS = 800
"""Events per millisecond that are kept for the rotation, spread evenly over it."""
_SEARCHES, _EVENTS_A_SEARCH = 3, 5000
"""Stretches that are searched for a rotation: the first, and one more for so many events. A search takes its second
however few events there are, and a recording whose time leaps has a stretch for each handful of them."""


class Measurement:
    """Measures a stream: `add` blocks of events in its order, then ask for the `report`.

    width, height: of the sensor [px]; window_ns: length of the windows of rate, noise and sharpness; rotation: whether
    to look for one; working: is told what goes on while that takes its seconds. An event earlier than one before it
    counts as if it came with that one; how many is reported. Where times go back by more than a window and 100 ms they
    begin anew, as with an episode of a bag, and go on behind the last one; how often is reported.
    """

    def __init__(
        self,
        width: int,
        height: int,
        window_ns: int = 10_000_000,
        rotation: bool = True,
        working: Callable[[str], None] = lambda text: None,
    ) -> None:
        if window_ns < 1000:
            raise ValueError(f"a window of {window_ns} ns is too short; take 1000 ns or more")
        check_pixels(width, height)
        self._rate, self._noise = Rate(window_ns), Noise(width, height)
        self._sharpness, self._size = Sharpness(width, height), (width, height)
        self._stretches = Stretches(max(window_ns, STEP_BACK_NS))
        self._window_ns, self._rotating, self._working = window_ns, rotation, working
        self._held: list[tuple[np.ndarray, ...]] = []
        self._first = self._latest = self._segment_first = self._window = 0
        self._started = False
        self._thinned: list[tuple[np.ndarray, ...]] = []
        self._segments: list[dict[str, Any]] = []
        self._searchable = self._searches = self._left_out = 0
        self.outside = self.backwards = 0

    def add(self, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        """Adds events: t int64 [n, ns], x, y uint16 [n], p uint8 [n]. They are copied where they are kept."""
        inside = (x < self._size[0]) & (y < self._size[1])
        if not inside.all():
            self.outside += int((~inside).sum())
            t, x, y, p = t[inside], x[inside], y[inside], p[inside]
        for part, own_t, anew in self._stretches.parts(t):
            self._add(own_t, x[part], y[part], p[part], anew)

    def _add(self, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, anew: bool) -> None:
        if not self._started:
            self._first = self._latest = self._segment_first = int(t[0])
            self._started = True
        sorted_t = np.maximum(np.maximum.accumulate(t), self._latest)
        self.backwards += int((sorted_t != t).sum())
        self._latest = int(sorted_t[-1])
        self._rate.add(sorted_t, p)
        self._add_windows(sorted_t, x, y, p)
        if self._rotating:
            if anew:
                self._close_segment()
                self._segment_first = int(sorted_t[0])
            self._add_rotation(sorted_t, x, y, p)

    def report(self) -> dict[str, Any]:
        """Reports the measures of all that was added; ends the measurement."""
        if self._held:
            self._close_window(self._latest - self._window_start(self._latest))
        if self._rotating:
            self._close_segment()
        result = self._rate.report()
        result |= {"t_first_ns": self._first if self._started else None,
                   "t_last_ns": self._latest if self._started else None}  # fmt: skip
        result |= {"window_ns": self._window_ns, "rotation": merge(self._segments) if self._rotating else None}
        if self._left_out:
            result["stretches_left_out"] = self._left_out
        result |= {"noise": self._noise.report(), "sharpness": self._sharpness.report()}
        result |= {"events_outside": self.outside, "time_steps_back": self.backwards}
        result |= {"times_begun_anew": self._stretches.begun_anew}
        return result

    def _window_start(self, t: int) -> int:
        return self._first + (t - self._first) // self._window_ns * self._window_ns

    def _add_windows(self, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        # unsigned, because the distance of two int64 can be larger than int64
        index = (t.view(np.uint64) - np.int64(self._first).view(np.uint64)) // np.uint64(self._window_ns)
        cuts = np.flatnonzero(np.diff(index)) + 1
        starts = [0, *cuts.tolist()]
        for start, end in zip(starts, [*cuts.tolist(), len(t)]):
            if self._held and self._window != index[start]:
                self._close_window(self._window_ns)
                self._noise.idle((int(index[start]) - self._window - 1) * self._window_ns)
            self._window = int(index[start])
            part = slice(start, end)
            self._held.append((x[part].copy(), y[part].copy(), p[part].copy()))

    def _close_window(self, length_ns: int) -> None:
        x, y, p = (np.concatenate([part[i] for part in self._held]) for i in range(3))
        self._held = []
        self._noise.add(x, y, p, length_ns)
        self._sharpness.add(x, y)

    def _add_rotation(self, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        start = 0
        while start < len(t):
            end = int(np.searchsorted(t, self._segment_first + SEGMENT_NS))
            if end > start:
                keep = _thin(t[start:end])
                self._thinned.append(tuple(v[start:end][keep].copy() for v in (t, x, y, p)))
                start = end
            if start < len(t):
                self._close_segment()
                behind = (int(t[start]) - self._segment_first) // SEGMENT_NS
                self._segment_first += behind * SEGMENT_NS

    def _close_segment(self) -> None:
        if not self._thinned:
            return
        t, x, y, p = (np.concatenate([part[i] for part in self._thinned]) for i in range(4))
        self._thinned = []
        self._searchable += len(t)
        if self._searches >= _SEARCHES + self._searchable // _EVENTS_A_SEARCH:
            self._left_out += 1
            return
        keep = usual_pixels(x, y, self._size[0])
        t, x, y, p = t[keep], x[keep].astype(np.float64), y[keep].astype(np.float64), p[keep].astype(np.int64)
        number = len(self._segments) + 1
        found = measure_rotation(t, x, y, p, lambda text: self._working(f"rotation, stretch {number}: {text}"))
        self._searches += found["why"] != TOO_FEW
        self._segments.append(found | {"events": len(t)})


def _thin(t: np.ndarray) -> np.ndarray:
    """Indices of at most about THIN_EVENTS per millisecond, evenly spread; t ascending."""
    _, start, count = np.unique(t // THIN_NS, return_index=True, return_counts=True)
    stride = -(-count // THIN_EVENTS)
    if (stride == 1).all():
        return np.arange(len(t))
    place = np.arange(len(t)) - np.repeat(start, count)
    return np.flatnonzero(place % np.repeat(stride, count) == 0)


def usual_pixels(x: np.ndarray, y: np.ndarray, width: int) -> np.ndarray:
    """Tells which events are not of hot pixels: pixels with over 20 times the mean of the active ones (bool [n])."""
    if not len(x):
        return np.ones(0, bool)
    _, which, counts = np.unique(y.astype(np.int64) * width + x, return_inverse=True, return_counts=True)
    usual: np.ndarray = counts[which] <= max(20 * counts.mean(), 50)
    return usual
