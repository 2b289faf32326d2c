"""Feeds an emulated camera with a recording, at the recording's pace or as fast as the driver reads."""

from __future__ import annotations

import abc
import time
from collections.abc import Callable, Iterator

from evis.events import open_recording
from evis.runtime.clock import NS
from nodes.camera.emulated.feed import Feed
from nodes.camera.emulated.reencode import UNORDERED, Reencoder
from nodes.camera.emulated.windows import windows_in_file_order, windows_in_time_order
from nodes.camera.usb.models import Model

WINDOW_NS = 1_000_000
"""A camera at real pace hands over what one window of device time holds [ns]."""
MOST_WINDOWS = 20
"""Windows that are handed over at once where pace is of no importance, or is lost: one by one they take more time."""
LATEST_START_NS = 3600 * NS
"""A recording that is encoded anew and starts later than this is sent from near 0: a camera counts from its start."""
IMU_ENDPOINT_ENCODING = "dvxplorer_mini"
"""Encoding of cameras whose samples come on an endpoint of their own; stretches of one window keep them near their
time."""


class _PacedFeed(Feed):
    """Supplies the pieces of an iterator, each when it is due: (device time [ns], bytes)."""

    def __init__(self, speed: float, now: Callable[[], int], sleep: Callable[[float], None]) -> None:
        super().__init__()
        self._speed, self._now, self._sleep = speed, now, sleep
        self._imu_ahead: list[bytes] = []
        """Packets beside the next piece."""
        self._pieces: Iterator[tuple[int, bytes]] | None = None
        self._left = memoryview(b"")
        self._next: tuple[int, bytes] | None = None
        self._origin: tuple[int, int] | None = None
        self._behind_ns = 0
        """Device time since the last piece was due, when it was handed over [ns]."""

    @abc.abstractmethod
    def _make_pieces(self) -> Iterator[tuple[int, bytes]]:
        """Yields the pieces in order, with the device times [ns] at which they are due."""

    def read(self, size: int, timeout_s: float) -> bytes | memoryview:
        if not self._left:
            self._fetch_piece(timeout_s)
        part, self._left = self._left[:size], self._left[size:]
        return part

    def _fetch_piece(self, timeout_s: float) -> None:
        """Makes the next piece the current one, once it is due. Raises EOFError at the end."""
        if self._pieces is None:
            self._pieces = self._make_pieces()
        if self._next is None:
            self._next = next(self._pieces, None)
            if self._next is None:
                raise EOFError
        due, data = self._next
        if self._speed:
            if self._origin is None:
                self._origin = (self._now(), due)
            due_at = self._origin[0] + round((due - self._origin[1]) / self._speed)
            if (early := due_at - self._now()) > 0:
                self._sleep(min(early / NS, timeout_s))
            late = self._now() - due_at
            if late < 0:
                return
            self._behind_ns = int(late * self._speed)
        if self._imu_ahead:
            self.imu_queue.put(self._imu_ahead)
            self._imu_ahead = []
            self.imu_queue.wait_taken()
        self._left, self._next = memoryview(data), None


class RecordingFeed(_PacedFeed):
    """Supplies a recording as the model sends it: the file's own bytes where it holds them, else encoded anew.

    speed: device time per real time, 0 = as fast as it is read. duration_s: 0 = all. topic: of a bag with several;
    "" = the first. now [ns], sleep [s]: the clock that keeps its pace.
    """

    def __init__(
        self,
        path: str,
        model: Model,
        speed: float,
        duration_s: float = 0.0,
        topic: str = "",
        now: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(speed, now, sleep)
        self._recording = open_recording(path, topic=topic)
        about = self.about = self._recording.info
        self.sends_own_bytes = about.encoding == model.encoding and about.format == "raw"
        first = self._recording.next_t_ns
        self.shift_ns = 0 if self.sends_own_bytes or first is None or first < LATEST_START_NS else first // NS * NS
        """What is subtracted from the recording's times [ns]; the driver is told and adds it again."""
        self._model = model
        self._encoder = None if self.sends_own_bytes else Reencoder(model, self.shift_ns, about.format)
        self._duration_ns = round(duration_s * NS)
        if about.width > model.width or about.height > model.height:
            self._recording.close()
            raise ValueError(
                f"{path}: {about.width}x{about.height} px do not fit on the {model.title} "
                f"({model.width}x{model.height}); choose a larger camera"
            )

    def _make_pieces(self) -> Iterator[tuple[int, bytes]]:
        recording = self._recording
        first = recording.next_t_ns
        if first is None:
            return
        end = first - 1 + self._duration_ns if self._duration_ns else None
        windows = windows_in_file_order(recording, self._window_ns, end)
        if self._encoder is not None and self._model.encoding not in UNORDERED:
            windows = windows_in_time_order(recording, self._window_ns, end, self._encoder.count_reordered)
        for stamp, events in windows:
            if self._encoder is None and self.register_filter is not None:
                # for good: words of the file would refer to those before them that were not sent
                self._encoder = Reencoder(self._model, self.shift_ns, recording.info.format)
            if self._encoder is None:
                yield stamp, self._own_bytes()
                continue
            data = self._encoder.encode(self.register_filter(events) if self.register_filter else events)
            self._imu_ahead += self._encoder.take_imu_packets()
            yield stamp, data
        if end is None:  # words behind the last event
            recording.read_until(2**62)
            if self._encoder is None:
                yield first, self._own_bytes()

    def _window_ns(self) -> int:
        """Returns the device time [ns] that the next piece is to hold."""
        if self._model.encoding == IMU_ENDPOINT_ENCODING:
            return WINDOW_NS
        windows = self._behind_ns // WINDOW_NS if self._speed else MOST_WINDOWS
        return min(max(windows, 1), MOST_WINDOWS) * WINDOW_NS

    def _own_bytes(self) -> bytes:
        """Returns the recording's own bytes of the last stretch."""
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
