"""Defines what a subscriber returns besides messages: the lease of each, and the end of the stream."""

from __future__ import annotations

import enum
from typing import Final, Protocol

from evis.bus import wire
from evis.bus.errors import BusError


class End(enum.Enum):
    """Marks the end of a stream; what `receive` returns once the publisher has ended it."""

    END = "end of stream"


END: Final = End.END


class Receiver(Protocol):
    """Describes the subscriber through which a message came, which answers its publisher."""

    topic: str

    def reply(self, op: bytes, seq: int) -> None:
        """Sends the publisher CREDIT, TAKEN or FREED of wire.py for a message."""

    def free_on_gpu(self, seq: int) -> None:
        """Sends the publisher FREED once the GPU is past all that was launched so far."""


class Lease:
    """Holds a received message: the first `unpin` returns its credit, the last one frees its slot."""

    __slots__ = ("_credited", "_on_gpu", "_pins", "_receiver", "_seq")

    def __init__(self, receiver: Receiver, seq: int, on_gpu: bool = False) -> None:
        """Takes a message with one pin. on_gpu: its arrays lie there, and work that reads them may be under way at the
        last `unpin`."""
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
        """Removes one user and answers the publisher. Raises BusError when there was none."""
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
