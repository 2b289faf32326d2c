"""Opens any recording or bag, holds it open for as long as it is wanted and reads it as it is gone over."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from evis.bag import BagError
from evis.bag.environments import of_one
from evis.events.arrays import Events
from evis.events.recording import Recording, RecordingError, RecordingInfo, open_recording
from evis.events.stretches import Stretches
from evis.recordings.whole_ns import whole_ns
from evis.recordings.windows import EventWindow, by_count, by_time, check_length, columns

if TYPE_CHECKING:
    from evis.bag.reader import BagReader
    from msgs.header import Message

_MCAP = b"\x89MCAP"


@dataclass(frozen=True)
class Counts:
    """Counts what a recording holds. start_ns, end_ns: first and last event in file order, None without events.

    duration_ns: from the one to the other; where times begin anew, as with episodes of a bag, those of all stretches.
    dropped: what the reader left out, by reason.
    """

    events: int = 0
    on: int = 0
    off: int = 0
    triggers: int = 0
    imu: int = 0
    frames: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    duration_ns: int = 0
    dropped: dict[str, int] = field(default_factory=dict)


class Recorded:
    """Reads one event stream of a recording, and of a bag all of its topics, and keeps no more of it than it gives.

    Going over it twice reads it twice; slicing gives the same for a part of the time: `rec[a:b]` is [a, b) in whole
    ns as the file has them, both ends may be left out. A context manager.

    path: the file. info: what it says about itself (format, encoding, sensor, warnings, truncated).
    """

    def __init__(
        self, path: Path, topic: str, size: tuple[int, int] | None, part: tuple[int | None, int | None] = (None, None)
    ) -> None:
        self.path, self._topic, self._given_size = path, topic, size
        self._start, self._stop = part
        self._closed = False

    # -- what it is --------------------------------------------------------------------------------------------------

    @cached_property
    def info(self) -> RecordingInfo:
        """Tells what the file says about itself. Raises RecordingError where it has no events."""
        with self._opened() as recording:
            return recording.info

    @property
    def width(self) -> int:
        """Returns the number of columns of the sensor."""
        return self.info.width

    @property
    def height(self) -> int:
        """Returns the number of rows of the sensor."""
        return self.info.height

    @cached_property
    def counts(self) -> Counts:
        """Counts events, triggers, inertial samples and frames, in one pass over the file."""
        found: dict[str, int] = dict.fromkeys(("events", "on", "triggers", "imu", "frames"), 0)
        first = last = None
        duration, stretches = 0, Stretches()
        dropped: dict[str, int] = {}
        for block in self._blocks(dropped):
            if len(block):
                first = int(block.t[0]) if first is None else first
                last = int(block.t[-1])
            for _, t, _ in stretches.parts(block.t):
                duration = int(t[-1]) - (first or 0)
            found["events"] += len(block)
            found["on"] += int(block.p.sum(dtype=int))
            found["triggers"] += len(block.triggers)
            found["imu"] += len(block.imu)
            found["frames"] += len(block.frames)
        off = found["events"] - found["on"]
        return Counts(**found, off=off, start_ns=first, end_ns=last, duration_ns=duration, dropped=dropped)

    @property
    def start_ns(self) -> int | None:
        """Returns the time of the first event [ns]; from `counts`."""
        return self.counts.start_ns

    @property
    def end_ns(self) -> int | None:
        """Returns the time of the last event [ns]; from `counts`."""
        return self.counts.end_ns

    @property
    def duration_ns(self) -> int:
        """Returns the time [ns] from the first event to the last, in each stretch of its own where times begin anew, as
        with episodes of a bag; from `counts`."""
        return self.counts.duration_ns

    @cached_property
    def topics(self) -> dict[str, str]:
        """Names what a bag holds and the types of the messages; of other files with several streams their names.

        `messages` takes all names of a bag, `evis.open(path, topic=...)` those of type EventPacket, of a bag of several
        environments those of one (/env3/cam0/events).
        """
        streams = dict.fromkeys(self._event_streams(), "EventPacket")
        if not self._is_mcap:
            return streams
        with self._bag() as bag:
            return dict(sorted({**streams, **bag.topics}.items()))

    def _event_streams(self) -> tuple[str, ...]:
        try:
            return self.info.topics
        except RecordingError:
            if self._is_mcap:
                return ()  # a bag without events
            raise

    # -- events ------------------------------------------------------------------------------------------------------

    def __iter__(self) -> Iterator[EventWindow]:
        """Yields the events as the file has them: packets of a bag, blocks of bounded size of other files."""
        for block in self._blocks({}):
            times = [block.t, block.triggers.t, block.imu.t, np.array([f.t_ns for f in block.frames], np.int64)]
            own = block.t if len(block) else np.concatenate(times)
            first, last = (int(own.min()), int(own.max()) + 1) if len(own) else (0, 0)
            yield EventWindow(block, first, last, self.width, self.height)

    def windows(self, dt: int | None = None, *, count: int | None = None, overlap: int = 0) -> Iterator[EventWindow]:
        """Goes over the events in windows of `dt` ns or of `count` events.

        Args:
            dt: length [ns]; the first window begins at the first event, or at the start of the slice. Empty windows
                between events are given too.
            count: number of events, in place of dt. The last window holds what is left.
            overlap: by how much a window reaches into the next one, in ns or events.

        Raises ValueError, and RecordingError for what the file turns out to be.
        """
        if (dt is None) == (count is None):
            raise ValueError("windows are by dt or by count: give one of the two")
        check_length("dt" if count is None else "count", dt if count is None else count, overlap)
        return self._by_time(dt, overlap) if dt is not None else self._by_count(int(count or 0), overlap)

    def _by_time(self, dt: int, overlap: int) -> Iterator[EventWindow]:
        for events, start, end in by_time(self._blocks({}, False), int(dt), int(overlap), self._start):
            yield EventWindow(events, start, end, self.width, self.height)

    def _by_count(self, count: int, overlap: int) -> Iterator[EventWindow]:
        for events in by_count(self._blocks({}, False), count, int(overlap)):
            yield EventWindow(events, int(events.t.min()), int(events.t.max()) + 1, self.width, self.height)

    def read(self) -> Events:
        """Reads all of it into memory, triggers, inertial samples and frames too."""
        return Events.concatenate([Events.empty(), *self._blocks({})])

    def numpy(self) -> dict[str, np.ndarray]:
        """Reads all events into memory: t int64 [n, ns], x, y uint16, p uint8 (1 = ON), and c where there is colour."""
        return columns(Events.concatenate([Events.empty(), *self._blocks({}, False)]))

    def __getitem__(self, part: slice) -> Recorded:
        if not isinstance(part, slice):
            raise TypeError(f"a recording is sliced by time, rec[start_ns:stop_ns], not by {part!r}")
        if part.step is not None:
            raise ValueError("a slice of a recording has no step; windows(dt=...) goes in steps")
        start, stop = (whole_ns(limit) for limit in (part.start, part.stop))
        starts = [limit for limit in (self._start, start) if limit is not None]
        stops = [limit for limit in (self._stop, stop) if limit is not None]
        inner = Recorded(
            self.path, self._topic, self._given_size, (max(starts, default=None), min(stops, default=None))
        )
        inner._closed = self._closed
        return inner

    def _opened(self) -> Recording:
        if self._closed:
            raise RecordingError(f"{self.path}: it has been closed; evis.open gives it again")
        return open_recording(self.path, size=self._given_size, topic=self._topic)

    def _blocks(self, dropped: dict[str, int], aside: bool = True) -> Iterator[Events]:
        """Yields the events of the part in blocks; what was dropped is filled in at the end. aside: triggers, inertial
        samples and frames are wanted, also those that the file has behind later events."""
        if self._given_size is None and self.info.width:
            self._given_size = self.width, self.height  # which some formats find by reading all of the file
        with self._opened() as recording:
            if self._start is not None:
                recording.seek(self._start)
            stretches = Stretches()
            for block in recording.blocks():
                ended, block = False, self._without_earlier(block, stretches)
                late = block.t >= self._stop if self._stop is not None else np.zeros(0, bool)
                if late.any():
                    ended, events = True, block[: int(np.argmax(late))]
                    if aside and self._stop is not None:
                        block = Events.concatenate([block, recording.read_aside(self._stop - 1)])
                    block = events.beside(block)
                yield block.beside(block.aside(self._start, self._stop))
                if ended:
                    break
            dropped.update(recording.counters())
            for text in recording.info.warnings:
                self.info.warn(text)
            self.info.truncated = self.info.truncated or recording.info.truncated

    def _without_earlier(self, block: Events, stretches: Stretches) -> Events:
        """Leaves out what is before the start of the slice where times have begun anew: the way to the start is not
        skipped there. Events that are out of order stay."""
        if self._start is None:
            return block
        kept = np.ones(len(block), bool)
        for part, _, _ in stretches.parts(block.t):
            if stretches.begun_anew:
                kept[part] = block.t[part] >= self._start
        return block if kept.all() else block[kept].beside(block)

    # -- other topics of a bag ---------------------------------------------------------------------------------------

    def messages(self, topic: str) -> Iterator[Message]:
        """Goes over the messages of one topic of a bag: frames, depth, labels, imu, state, ...

        Of a slice, those whose stamps lie in it. Raises RecordingError, naming the topics that there are.
        """
        if not self._is_mcap:
            raise RecordingError(f"{self.path}: no bag with messages; go over the recording itself for what it holds")
        return self._messages(topic)

    def _messages(self, topic: str) -> Iterator[Message]:
        stop = None if self._stop is None else self._stop - 1
        with self._bag() as bag:
            whole, env = (topic, None) if topic in bag.topics else _environment(topic, self._event_streams())
            try:
                for _, message in bag.messages([whole], self._start, stop):
                    part = message if env is None else of_one(message, env)
                    if part is not None:
                        yield part
            except BagError as error:
                raise RecordingError(str(error)) from None

    @cached_property
    def _is_mcap(self) -> bool:
        try:
            with self.path.open("rb") as file:
                return file.read(len(_MCAP)) == _MCAP
        except OSError:
            return False

    def _bag(self) -> BagReader:
        from evis.bag.reader import BagReader

        if self._closed:
            raise RecordingError(f"{self.path}: it has been closed; evis.open gives it again")
        try:
            return BagReader(self.path)
        except BagError as error:
            raise RecordingError(str(error)) from None

    # -- the end -----------------------------------------------------------------------------------------------------

    def close(self) -> None:
        """Closes the file: nothing can be read any more. Files are open only while they are gone over."""
        self._closed = True

    def __enter__(self) -> Recorded:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        part = "" if self._start is None and self._stop is None else f"[{self._start}:{self._stop}]"
        return f"evis.open({str(self.path)!r}{f', topic={self._topic!r}' if self._topic else ''}){part}"


def _environment(topic: str, streams: Iterable[str]) -> tuple[str, int | None]:
    """Splits the name of an environment's events, /env3/cam0/events, into the topic of all and its number."""
    parts = re.fullmatch(r"/env(\d+)(/.*)", topic) if topic in streams else None
    return (parts[2], int(parts[1])) if parts else (topic, None)


def open_recorded(path: str | os.PathLike[str], topic: str = "", *, size: tuple[int, int] | None = None) -> Recorded:
    """Opens any recording or bag, whatever its name says: the content decides. Files are read as they are gone over.

    Args:
        path: a file of any format that `evis events info` knows, or the folder of a ROS 2 bag.
        topic: the event stream to read where there are several, as /cam1/events; the first where it is not given.
        size: (width, height) of the sensor, in place of what the file says.

    Raises RecordingError with one line that names the file, now and while the recording is read.
    """
    recorded = Recorded(Path(path), topic, size)
    if topic or not recorded._is_mcap:
        _ = recorded.info  # what cannot be read is said now
    else:
        _ = recorded.topics  # a bag may hold no events
    return recorded
