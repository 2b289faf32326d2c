"""Defines what a subscriber gives out beside the messages: the hold on each of them, and the end of the stream."""

from __future__ import annotations

import enum
from typing import Final, Protocol

from evis.bus import wire
from evis.bus.errors import BusError


class End(enum.Enum):
    """Stands for the end of a stream: what `receive` returns when the publisher has ended it."""

    END = "end of stream"


END: Final = End.END


class Receiver(Protocol):
    """Stands for the subscriber that a message came through, which answers its publisher."""

    topic: str

    def reply(self, op: bytes, seq: int) -> None:
        """Tells the publisher what becomes of a message: CREDIT, TAKEN or FREED of wire.py."""

    def free_on_gpu(self, seq: int) -> None:
        """Tells the publisher FREED when the GPU is past all that was launched so far."""


class Lease:
    """Holds a received message. The first `unpin` returns its credit; when no pin is left its slot may be reused."""

    __slots__ = ("_credited", "_on_gpu", "_pins", "_receiver", "_seq")

    def __init__(self, receiver: Receiver, seq: int, on_gpu: bool = False) -> None:
        """on_gpu: its arrays lie there, where what reads them may still be under way at the last `unpin`."""
        self._receiver = receiver
        self._seq = seq
        self._on_gpu = on_gpu
        self._pins = 1
        self._credited = False

    def pin(self) -> None:
        """Keeps the arrays valid for one more user. Raises BusError after the last release."""
        if not self._pins:
            raise BusError(f"topic {self._receiver.topic}: a message was kept after its release")
        self._pins += 1

    def unpin(self) -> None:
        """Takes one user away and answers the publisher. Raises BusError when there was none."""
        if not self._pins:
            raise BusError(f"topic {self._receiver.topic}: a message was released more often than it was kept")
        self._pins -= 1
        if self._on_gpu and not self._pins:
            if not self._credited:
                self._receiver.reply(wire.TAKEN, self._seq)
            self._receiver.free_on_gpu(self._seq)
        elif not self._pins:
            self._receiver.reply(wire.FREED if self._credited else wire.CREDIT, self._seq)
        elif not self._credited:
            self._credited = True
            self._receiver.reply(wire.TAKEN, self._seq)
