"""Cuts a stream of blocks into windows of equal length or of equal number."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.events.arrays import Events
from evis.events.recording import RecordingError

MOST_EMPTY = 1_000_000
"""Empty windows in a row, after which a jump of the times is more likely than a pause."""


@dataclass(frozen=True)
class EventWindow:
    """Holds consecutive events of a recording, and the time that they cover.

    events: t int64 [n, ns], x, y uint16, p uint8 (1 = ON), c uint8 or None; in the file's order. start_ns, end_ns: the
    time covered, [start_ns, end_ns). width, height: of the sensor. Representations take it as it is.
    """

    events: Events
    start_ns: int
    end_ns: int
    width: int
    height: int

    @property
    def t(self) -> np.ndarray:
        """Returns the times [ns]."""
        return self.events.t

    @property
    def x(self) -> np.ndarray:
        """Returns the columns."""
        return self.events.x

    @property
    def y(self) -> np.ndarray:
        """Returns the rows."""
        return self.events.y

    @property
    def p(self) -> np.ndarray:
        """Returns the polarities, uint8 [n]: 1 = ON, 0 = OFF."""
        return self.events.p

    @property
    def c(self) -> np.ndarray | None:
        """Returns the colour channels, uint8 [n]; None without colour."""
        return self.events.c

    def __len__(self) -> int:
        return len(self.events)

    def numpy(self) -> dict[str, np.ndarray]:
        """Gives the columns by name: t, x, y, p, and c where there is colour."""
        return columns(self.events)


def columns(events: Events) -> dict[str, np.ndarray]:
    """Gives the columns of events by name."""
    found = {"t": events.t, "x": events.x, "y": events.y, "p": events.p}
    return found if events.c is None else found | {"c": events.c}


def check_length(name: str, value: Any, overlap: Any) -> None:
    """Raises ValueError unless both are whole and windows of this length advance."""
    for what, number, least in ((name, value, 1), ("overlap", overlap, 0)):
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < least:
            unit = "ns" if name == "dt" else "events"
            raise ValueError(f"{what} is {number!r}; it must be a whole number of {unit}, {least} or more")
    if overlap >= value:
        raise ValueError(f"windows of {value} that overlap by {overlap} do not advance; overlap must be less")


def by_time(blocks: Iterable[Events], dt: int, overlap: int, begin: int | None) -> Iterator[tuple[Events, int, int]]:
    """Yields (events, start, end) of windows [start, start + dt), the next one dt - overlap later.

    begin: start of the first window, None = the first event. Empty windows between events are given too. Events that a
    sensor sent out of order stay where they came; where times go back by more than dt the windows begin anew. Raises
    RecordingError at a jump over more than MOST_EMPTY windows.
    """
    waiting, start, empty = Events.empty(), begin, 0
    for part in _without_steps_back(blocks, dt):
        if start is not None and len(waiting) and part.t[0] < waiting.t[-1] - dt:
            yield waiting, start, start + dt
            waiting, start = Events.empty(), None
        if start is None:
            start = int(part.t[0])
        waiting, at = Events.concatenate([waiting, part]), 0
        latest = np.maximum.accumulate(waiting.t)  # the first event that is late is where this becomes late
        while latest[-1] >= start + dt:
            end = int(np.searchsorted(latest, start + dt))
            empty = 0 if end > at else empty + 1
            if empty > MOST_EMPTY:
                raise RecordingError(
                    f"no event from {start} ns to {int(waiting.t[end])} ns, {MOST_EMPTY} windows of {dt} ns and more: "
                    "slice the recording around it, or take windows by count"
                )
            yield waiting[at:end], start, start + dt
            start += dt - overlap
            at = int(np.searchsorted(latest, start))
        waiting = waiting[at:]
    if start is not None and len(waiting):
        yield waiting, start, start + dt


def _without_steps_back(blocks: Iterable[Events], dt: int) -> Iterator[Events]:
    for block in blocks:
        cuts = np.flatnonzero(block.t[1:] < block.t[:-1] - dt) + 1
        for a, b in zip([0, *cuts.tolist()], [*cuts.tolist(), len(block)]):
            if b > a:
                yield block[a:b]


def by_count(blocks: Iterable[Events], count: int, overlap: int) -> Iterator[Events]:
    """Yields windows of `count` events, the next one count - overlap later; the last holds what is left."""
    waiting, held, fresh = [Events.empty()], 0, 0
    for block in blocks:
        waiting, held, fresh = [*waiting, block], held + len(block), fresh + len(block)
        if held < count:
            continue
        joined, at = Events.concatenate(waiting), 0
        while len(joined) - at >= count:
            yield joined[at : at + count]
            at += count - overlap
        waiting, held = [joined[at:]], len(joined) - at
        fresh = held - overlap
    if fresh > 0:
        yield Events.concatenate(waiting)[:]
