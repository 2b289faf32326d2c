"""What a subscriber gives out beside the messages: the hold on each of them, and the end of the stream."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Final

from evis.bus import wire
from evis.bus.errors import BusError

if TYPE_CHECKING:
    from evis.bus.subscriber import Subscriber


class End(enum.Enum):
    """What `receive` returns when the publisher has ended the stream."""

    END = "end of stream"


END: Final = End.END


class Lease:
    """Hold on a received message. The first `unpin` returns the credit; when no pin is left its slot may be reused."""

    __slots__ = ("_credited", "_pins", "_seq", "_subscriber")

    def __init__(self, subscriber: Subscriber, seq: int) -> None:
        self._subscriber = subscriber
        self._seq = seq
        self._pins = 1
        self._credited = False

    def pin(self) -> None:
        """Keep the arrays valid for one more user."""
        if not self._pins:
            raise BusError(f"topic {self._subscriber.topic}: a message was kept after its release")
        self._pins += 1

    def unpin(self) -> None:
        """One user less."""
        if not self._pins:
            raise BusError(f"topic {self._subscriber.topic}: a message was released more often than it was kept")
        self._pins -= 1
        if not self._pins:
            self._subscriber.reply(wire.FREED if self._credited else wire.CREDIT, self._seq)
        elif not self._credited:
            self._credited = True
            self._subscriber.reply(wire.TAKEN, self._seq)
