"""Filters events as an emulated sensor's registers ask for: region of interest, event rate, frames, inertial
samples."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evis.events.arrays import Events, Imu


@dataclass
class RateLimit:
    """Applies a sensor's event rate controller: at most `most` events in each period of `period_ns`.

    What is above is left out evenly over the period, as the sensor's does that lets every so many-th event through.
    """

    most: int
    period_ns: int
    _last: tuple[int, int] = (-1, 0)
    """The newest period, and how many events of it went through already."""

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Returns which of the events at times t [ns] pass; later events of the same period may come in a later
        call."""
        keep = np.ones(len(t), bool)
        # stretches of a recording end with a period's last ns, so that a period is (k - 1, k] periods
        periods = -(-t // self.period_ns)
        starts = np.flatnonzero(np.diff(periods, prepend=periods[:1] - 1))
        for start, end in zip(starts, [*starts[1:], len(t)]):
            period, n = int(periods[start]), int(end - start)
            before = self._last[1] if period == self._last[0] else 0
            room = min(n, max(0, self.most - before))
            if room < n:
                i = np.arange(n)
                keep[start:end] = (i + 1) * room // n > i * room // n
            self._last = period, before + room
        return keep


@dataclass
class Readout:
    """Filters events as a sensor's registers describe.

    columns, rows: which of the sensor's pass, by their number on the wire; None = all. transform: applied to the events
    that pass. counts: counts what the rate controller drops.
    """

    counts: Counter[str]
    columns: np.ndarray | None = None
    rows: np.ndarray | None = None
    limit: RateLimit | None = None
    frames: bool = True
    imu: bool = True
    transform: Callable[[Events], Events] | None = None

    @property
    def passes_all(self) -> bool:
        """Tells whether all events pass unchanged, so that a recording's own bytes can be sent."""
        parts = (self.columns, self.rows, self.limit, self.transform)
        return all(part is None for part in parts) and self.frames and self.imu

    def __call__(self, events: Events) -> Events:
        """Returns the events, frames and samples that the sensor sends."""
        keep = np.ones(len(events), bool)
        if self.columns is not None:
            keep &= self.columns[events.x]
        if self.rows is not None:
            keep &= self.rows[events.y]
        if self.limit is not None:
            passed = np.flatnonzero(keep)[~self.limit(events.t[keep])]
            keep[passed] = False
            self.counts["events_over_rate_limit"] += len(passed)
        kept = {name: getattr(events, name)[keep] for name in ("t", "x", "y", "p")}
        events = dataclasses.replace(events, **kept, c=None if events.c is None else events.c[keep])
        if not self.frames:
            events = dataclasses.replace(events, frames=[])
        if not self.imu:
            events = dataclasses.replace(events, imu=Imu())
        return self.transform(events) if self.transform else events


def lines_of_masks(words: list[int | None], size: int) -> np.ndarray | None:
    """Returns the columns or rows whose bits are set, 32 per register; None where no register was written or all are
    set."""
    if all(word is None for word in words):
        return None
    values = np.array([0xFFFF_FFFF if word is None else word for word in words], "<u4")
    lines = np.unpackbits(values.view(np.uint8), bitorder="little")[:size].astype(bool)
    return None if lines.all() else lines


def lines_between(first: int, last: int, size: int) -> np.ndarray | None:
    """Returns the columns or rows first .. last; None where these are all."""
    lines = np.zeros(size, bool)
    lines[first : last + 1] = True
    return None if lines.all() else lines
