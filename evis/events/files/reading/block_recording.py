"""Implements what the readers of formats with blocks of events share: cuts in time, seeking, the sensor's size."""

from __future__ import annotations

import abc
from collections.abc import Iterator
from typing import ClassVar, TypeVar

import numpy as np

from evis.events.arrays import Events, Imu, Triggers
from evis.events.recording import LATE_NS, OpenOptions, Recording, RecordingError, RecordingInfo
from evis.files.damage import faults_as

_Samples = TypeVar("_Samples", Triggers, Imu)


class BlockRecording(Recording):
    """Cuts events by time for recordings whose `_load` yields them in blocks of bounded size.

    Triggers, IMU samples and frames come with the block in which the file has them. Events outside of the sensor's
    size are dropped and counted. A subclass sets `info` before it calls `__init__`.
    """

    own_packets: ClassVar[bool] = False
    """Triggers, IMU samples and frames may come in the file behind later events."""

    def __init__(self) -> None:
        self._source = self._load()
        self._block, self._at = Events.empty(), 0
        self._waiting: list[Events] = []
        self._counts: dict[str, int] = {}

    @abc.abstractmethod
    def _load(self) -> Iterator[Events]:
        """Yields the file's events in blocks, from its start."""

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        """Yields blocks as `_load` does, from a place before which everything is earlier than t_ns."""
        return self._load()

    def count(self, what: str, n: int = 1) -> None:
        """Counts something that was dropped or damaged."""
        self._counts[what] = self._counts.get(what, 0) + n

    def counters(self) -> dict[str, int]:
        return {k: v for k, v in self._counts.items() if v}

    # -- reading -----------------------------------------------------------------------------------------------------

    def _more(self) -> bool:
        """Makes the current block one with unread events; False at the end."""
        while self._at >= len(self._block):
            with faults_as(RecordingError, self.info.path):
                block = next(self._source, None)
            if block is None:
                return False
            self._block, self._at = self._inside(block), 0
            if block.has_aside:
                self._waiting.append(block.without_events())
        return True

    @property
    def _aside(self) -> Events:
        """Returns the triggers, IMU samples and frames that were loaded and not given yet."""
        if len(self._waiting) > 1:
            self._waiting = [Events.concatenate(self._waiting)]
        return self._waiting[0] if self._waiting else Events.empty()

    def _inside(self, events: Events) -> Events:
        """Selects the events inside the sensor, and counts the others."""
        width, height = self.info.width, self.info.height
        if not len(events) or not width or (events.x.max() < width and events.y.max() < height):
            return events
        keep = (events.x < width) & (events.y < height)
        self.count("events_outside", len(keep) - int(np.count_nonzero(keep)))
        colour = None if events.c is None else events.c[keep]
        return Events(events.t[keep], events.x[keep], events.y[keep], events.p[keep], colour)

    def blocks(self) -> Iterator[Events]:
        while self._more():
            part, self._at = self._block[self._at :], len(self._block)
            yield self._with_aside(part, None)
        if self._waiting:
            yield self._with_aside(Events.empty(), None)

    def read(self) -> Events:
        parts = [Events.empty()]
        while self._more():
            parts.append(self._block[self._at :])
            self._at = len(self._block)
        return self._with_aside(Events.concatenate(parts), None)

    def read_until(self, t_ns: int) -> Events:
        parts = [Events.empty()]
        while self._more():
            late = self._block.t[self._at :] > t_ns
            n = int(np.argmax(late)) if late.any() else len(late)
            parts.append(self._block[self._at : self._at + n])
            self._at += n
            if n < len(late):
                break
        return self._with_aside(Events.concatenate(parts), t_ns)

    def read_aside(self, t_ns: int) -> Events:
        found = [self._aside.aside(None, t_ns + 1)]
        self._waiting = []
        while self.own_packets and self._more() and int(self._block.t[self._at]) <= t_ns + LATE_NS:
            self._at = len(self._block)
            found.append(self._aside.aside(None, t_ns + 1))
            self._waiting = []
        return Events.concatenate([*found, self._aside.aside(None, t_ns + 1)])

    def _with_aside(self, events: Events, t_ns: int | None) -> Events:
        """Returns `events` with the waiting triggers, IMU samples and frames up to t_ns (None: all)."""
        if not self._waiting:
            return events
        aside, later = (self._aside, Events.empty()) if t_ns is None else split_aside(self._aside, t_ns)
        self._waiting = [later] if later.has_aside else []
        return events.beside(aside)

    @property
    def next_t_ns(self) -> int | None:
        first = [int(self._block.t[self._at])] if self._more() else []
        first += [int(t[0]) for t in _aside_times(self._aside) if len(t)]
        return min(first, default=None)

    def seek(self, t_ns: int) -> None:
        self._counts.clear()
        with faults_as(RecordingError, self.info.path):
            self._source = self._load_from(t_ns)
        self._block, self._at, self._waiting = Events.empty(), 0, []
        more = True
        while more:
            more = self._more()
            self._with_aside(Events.empty(), t_ns - 1)
            reached = self._block.t >= t_ns
            self._at = int(np.argmax(reached)) if reached.any() else len(reached)
            more = more and self._at == len(reached)

    # -- the sensor's size -------------------------------------------------------------------------------------------

    def _size_from_events(self, sensors: tuple[tuple[int, int], ...] = ()) -> None:
        """Sets the size to the smallest of `sensors` that holds all events, or else to the largest coordinates.

        Reads the whole file once. Called before `__init__`, with `info` set and no size in it.
        """
        self._counts = {}
        info, width, height = self.info, 0, 0
        for events in self._load():
            if len(events):
                width, height = max(width, int(events.x.max()) + 1), max(height, int(events.y.max()) + 1)
        for w, h in sensors:
            if width <= w and height <= h and width:
                info.width, info.height, info.geometry_from = w, h, "sensor"
                info.warn(f"no sensor size in the file: {w}x{h} is the smallest sensor of this format that fits")
                return
        info.width, info.height, info.geometry_from = width, height, "events"
        info.warn(f"no sensor size in the file: {width}x{height} are the largest coordinates")


def take_size(info: RecordingInfo, options: OpenOptions) -> bool:
    """Sets the size that the user gives, and tells whether one was given."""
    if options.size:
        (info.width, info.height), info.geometry_from = options.size, "option"
    return options.size is not None


def split_aside(events: Events, t_ns: int) -> tuple[Events, Events]:
    """Splits triggers, IMU samples and frames, each kind by itself, at the first one later than t_ns.

    Both parts are without events.
    """
    n = [_until(t, t_ns) for t in _aside_times(events)]
    before, later = Events.empty(), Events.empty()
    before.triggers, later.triggers = _split(events.triggers, n[0])
    before.imu, later.imu = _split(events.imu, n[1])
    before.frames, later.frames = events.frames[: n[2]], events.frames[n[2] :]
    return before, later


def _aside_times(aside: Events) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return aside.triggers.t, aside.imu.t, np.array([f.t_ns for f in aside.frames], np.int64)


def _until(t: np.ndarray, t_ns: int) -> int:
    late = t > t_ns
    return int(np.argmax(late)) if late.any() else len(t)


def _split(samples: _Samples, n: int) -> tuple[_Samples, _Samples]:
    """Splits samples into the first n, and the others."""
    kind, arrays = type(samples), [getattr(samples, name) for name in samples.__slots__]
    return kind(*(a[:n] for a in arrays)), kind(*(a[n:] for a in arrays))
