"""Feeds an emulated camera with bytes: of a recording, of the simulator, or of a steady flood."""

from __future__ import annotations

import abc
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np

from evis.events import Events, open_recording
from evis.runtime.clock import NS
from nodes.camera.emulated.reencode import UNORDERED, Reencoder
from nodes.camera.emulated.windows import plain_windows, sorted_windows
from nodes.camera.usb.models import Model

WINDOW_NS = 1_000_000
"""A camera at real pace hands over what one window of device time holds [ns]."""
LATEST_START_NS = 3600 * NS
"""A recording that is encoded anew and starts later than this is sent from near 0: a camera counts from its start."""
BESIDE = "dvxplorer_mini"
"""Its samples come on an endpoint of their own; stretches of one window keep them near the events of their time."""
SIDE_TAKEN_S = 5.0
"""So long the events of a stretch wait for the samples before them to be taken, and then for none any more [s]."""
PIECE = 1 << 20


class SideQueue:
    """Holds packets of a second endpoint, and whether anybody takes them.

    A packet is taken when its reader comes for the next one: then it has noted when the one before came.
    """

    def __init__(self) -> None:
        self._packets: deque[bytes] = deque()
        self._changed = threading.Condition()
        self._wanted = False
        self._in_hand = False

    def expect(self, somebody: bool) -> None:
        """Notes whether packets will be taken, for the device was told to send them."""
        with self._changed:
            self._wanted = somebody

    def put(self, packets: list[bytes]) -> None:
        """Appends a packet."""
        with self._changed:
            self._packets.extend(packets)
            self._changed.notify_all()

    def get(self, timeout_s: float) -> bytes:
        """Returns the next packet; no bytes when none came in time."""
        with self._changed:
            self._wanted, self._in_hand = True, False
            self._changed.notify_all()
            self._in_hand = self._changed.wait_for(lambda: bool(self._packets), timeout_s)
            return self._packets.popleft() if self._in_hand else b""

    def wait_taken(self) -> None:
        """Waits until all are taken, if anybody takes them."""
        with self._changed:
            if self._wanted:
                self._wanted = self._changed.wait_for(lambda: not (self._packets or self._in_hand), SIDE_TAKEN_S)


class Feed(abc.ABC):
    """Supplies the bytes of a bulk endpoint, taken by `read`. None of them is lost while nobody reads."""

    def __init__(self) -> None:
        self.side = SideQueue()

    @abc.abstractmethod
    def read(self, size: int, timeout_s: float) -> bytes | memoryview:
        """Returns at most `size` bytes; none when nothing came in time. Raises EOFError at the end."""

    change: Callable[[Events], Events] | None = None
    """What the device's registers make of the events of a recording; None = nothing, its bytes can be sent as they are.
    Known when the first bytes are read."""
    shift_ns = 0
    """Added to the device's times by the driver, so that a recording keeps its own."""

    @property
    def first_ns(self) -> int | None:
        """Returns the time of the first event, where that is known beforehand."""
        return None

    def counters(self) -> dict[str, int]:
        """Counts what the device cannot send, by kind."""
        return {}

    def close(self) -> None:  # noqa: B027 - most feeds hold nothing
        """Releases what the feed holds; called when no more is needed."""


class _Pieces(Feed):
    """A feed from an iterator of (time at which they are due [ns of device time], bytes)."""

    def __init__(
        self,
        speed: float,
        now: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__()
        self._speed, self._now, self._sleep = speed, now, sleep
        self._ahead: list[bytes] = []
        """Packets beside the next piece."""
        self._pieces: Iterator[tuple[int, bytes]] | None = None
        self._left = memoryview(b"")
        self._next: tuple[int, bytes] | None = None
        self._origin: tuple[int, int] | None = None

    @abc.abstractmethod
    def _make(self) -> Iterator[tuple[int, bytes]]:
        """The pieces in order."""

    def read(self, size: int, timeout_s: float) -> bytes | memoryview:
        if not self._left:
            self._fetch(timeout_s)
        part, self._left = self._left[:size], self._left[size:]
        return part

    def _fetch(self, timeout_s: float) -> None:
        """Make the next piece the current one, if it is due in time."""
        if self._pieces is None:
            self._pieces = self._make()
        if self._next is None:
            self._next = next(self._pieces, None)
            if self._next is None:
                raise EOFError
        due, data = self._next
        if self._speed:
            if self._origin is None:
                self._origin = (self._now(), due)
            wait = (self._origin[0] + (due - self._origin[1]) / self._speed - self._now()) / NS
            if wait > timeout_s:
                self._sleep(timeout_s)
                return
            if wait > 0:
                self._sleep(wait)
        if self._ahead:
            self.side.put(self._ahead)
            self._ahead = []
            self.side.wait_taken()
        self._left, self._next = memoryview(data), None


class RecordingFeed(_Pieces):
    """Supplies a recording as the model sends it: the file's own bytes where it holds them, else encoded anew.

    speed: device time per real time, 0 = as fast as it is read. duration_s: 0 = all. topic: of a bag with several;
    "" = the first.
    """

    def __init__(self, path: str, model: Model, speed: float, duration_s: float = 0.0, topic: str = "") -> None:
        super().__init__(speed)
        self._recording = open_recording(path, topic=topic)
        about = self.about = self._recording.info
        self.same = about.encoding == model.encoding and about.format == "raw"
        first = self._recording.next_t_ns
        self.shift_ns = 0 if self.same or first is None or first < LATEST_START_NS else first // NS * NS
        """What is subtracted from the recording's times [ns]; the driver is told and adds it again."""
        self._model = model
        self._encoder = None if self.same else Reencoder(model, self.shift_ns, about.format)
        self._duration_ns = round(duration_s * NS)
        if about.width > model.width or about.height > model.height:
            self._recording.close()
            raise ValueError(
                f"{path}: {about.width}x{about.height} px do not fit on the {model.title} "
                f"({model.width}x{model.height}); choose a larger camera"
            )

    def _make(self) -> Iterator[tuple[int, bytes]]:
        recording = self._recording
        first = recording.next_t_ns
        if first is None:
            return
        if self._encoder is None and self.change is not None:
            self._encoder = Reencoder(self._model, self.shift_ns, recording.info.format)
        end = first - 1 + self._duration_ns if self._duration_ns else None
        window = WINDOW_NS if self._speed or self._model.encoding == BESIDE else 20 * WINDOW_NS
        if self._encoder is None:
            for stamp, _ in plain_windows(recording, window, end):
                yield stamp, self._wire()
        else:
            windows = plain_windows(recording, window, end)
            if self._model.encoding not in UNORDERED:
                windows = sorted_windows(recording, window, end, self._encoder.count_reordered)
            for stamp, events in windows:
                data = self._encoder.encode(self.change(events) if self.change else events)
                self._ahead += self._encoder.take_beside()
                yield stamp, data
        if end is None:  # words behind the last event
            recording.read_until(2**62)
            if self._encoder is None:
                yield first, self._wire()

    def _wire(self) -> bytes:
        """The file's own bytes of the last stretch."""
        raw = self._recording.raw
        assert raw is not None
        return raw.tobytes()

    @property
    def first_ns(self) -> int | None:
        first = self._recording.next_t_ns
        return first

    def counters(self) -> dict[str, int]:
        return dict(self._encoder.counts) if self._encoder is not None else {}

    def close(self) -> None:
        self._recording.close()


class LiveFeed(Feed):
    """Supplies bytes that another thread puts in: the simulator's own events, encoded."""

    def __init__(self) -> None:
        super().__init__()
        self._queue: deque[memoryview] = deque()
        self._changed = threading.Condition()
        self._ended = False

    def put(self, data: bytes) -> None:
        """Appends bytes."""
        with self._changed:
            if data:
                self._queue.append(memoryview(data))
                self._changed.notify_all()

    def end(self) -> None:
        """Ends the feed: nothing more will come."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def read(self, size: int, timeout_s: float) -> bytes | memoryview:
        with self._changed:
            if not self._queue:
                if self._ended:
                    raise EOFError
                self._changed.wait(timeout_s)
            if not self._queue:
                return b""
            part = self._queue.popleft()
            if len(part) > size:
                self._queue.appendleft(part[size:])
            return part[:size]


class FloodFeed(Feed):
    """Supplies prepared bytes over and over, at a steady rate [bytes/s], as a sensor that waits for nobody.

    repeat(turn) gives the bytes of one turn, so that their times can go on. fifo: bytes that the camera itself can hold
    while nobody reads; what does not fit is lost in the camera and counted in `lost`.
    """

    def __init__(self, turns: Iterator[np.ndarray], rate: float, fifo: int = 1 << 20, seconds: float = 0.0) -> None:
        super().__init__()
        self._turns, self._rate, self._fifo, self._seconds = turns, rate, fifo, seconds
        self._current = next(turns)
        self._at = 0
        self._began = 0.0
        self._taken = 0
        self.lost = 0
        self.offered = 0

    def read(self, size: int, timeout_s: float) -> bytes | memoryview:
        now = time.monotonic()
        if not self._began:
            self._began = now
        if self._seconds and now - self._began > self._seconds:
            raise EOFError
        wanted = min(size, self._fifo)
        ready = int((now - self._began) * self._rate) - self._taken
        if ready < wanted:
            time.sleep(min((wanted - ready) / self._rate, timeout_s))
            ready = int((time.monotonic() - self._began) * self._rate) - self._taken
        over = max(ready - self._fifo, 0)
        if over:
            over &= ~1
            self.lost += over
            self._advance(over)
        size = min(size, self._fifo, ready - over, len(self._current) - self._at or PIECE)
        if self._at == len(self._current):
            self._current, self._at = next(self._turns), 0
            size = min(size, len(self._current))
        part = self._current[self._at : self._at + size]
        self._at += size
        self._taken += size
        self.offered = self._taken
        return part.data

    def _advance(self, count: int) -> None:
        """Skip bytes that were lost."""
        self._taken += count
        while count:
            if self._at == len(self._current):
                self._current, self._at = next(self._turns), 0
            step = min(count, len(self._current) - self._at)
            self._at += step
            count -= step
