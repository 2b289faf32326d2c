"""Defines what feeds an emulated camera with bytes, and feeds it with those of another thread."""

from __future__ import annotations

import abc
import threading
from collections import deque
from collections.abc import Callable

from evis.events import Events

IMU_TAKEN_S = 5.0
"""Longest time that the events of a stretch wait for the samples before them to be read; then for none any more [s]."""


class ImuQueue:
    """Queues packets of inertial samples for an endpoint of their own, and knows whether they are being read.

    A packet is taken when its reader comes for the next one: then it has noted when the one before came.
    """

    def __init__(self) -> None:
        self._packets: deque[bytes] = deque()
        self._changed = threading.Condition()
        self._wanted = False
        self._in_hand = False

    def expect(self, somebody: bool) -> None:
        """Sets whether packets will be read, as the device's registers say."""
        with self._changed:
            self._wanted = somebody

    def put(self, packets: list[bytes]) -> None:
        """Appends packets."""
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
        """Waits until all packets are read, if they are being read at all."""
        with self._changed:
            if self._wanted:
                self._wanted = self._changed.wait_for(lambda: not (self._packets or self._in_hand), IMU_TAKEN_S)


class Feed(abc.ABC):
    """Supplies the bytes of an emulated camera's data endpoint; none is lost while nobody reads."""

    def __init__(self) -> None:
        self.imu_queue = ImuQueue()

    @abc.abstractmethod
    def read(self, size: int, timeout_s: float) -> bytes | memoryview:
        """Returns at most `size` bytes; none when nothing came in time. Raises EOFError at the end."""

    register_filter: Callable[[Events], Events] | None = None
    """What the device's registers make of the events of a recording; None = nothing, its bytes can be sent as they are.
    Known when the first bytes are read, and set anew when registers change."""
    shift_ns = 0
    """Added to the device's times by the driver, so that a recording keeps its own."""

    @property
    def first_ns(self) -> int | None:
        """Returns the time of the first event [ns]; None where it is not known beforehand."""
        return None

    def counters(self) -> dict[str, int]:
        """Returns how much the device cannot send, by kind."""
        return {}

    def close(self) -> None:  # noqa: B027 - most feeds hold nothing
        """Closes the recording behind the feed, where there is one."""


class LiveFeed(Feed):
    """Supplies the bytes that another thread puts in: the simulator's events, encoded."""

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
        """Ends the feed; no bytes will follow."""
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
