"""Lets a node subscribe to a topic at run time; messages may be lost, and are counted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from evis.bus import Subscriber
from msgs.header import Message


@dataclass
class TapSubscription:
    """Reads one topic by taps, one per process for a system topic; the executor calls `callback` with each message."""

    topic: str
    callback: Callable[[Message], None]
    subscribers: list[Subscriber]
    on_close: Callable[[TapSubscription], None]

    def close(self) -> None:
        """Ends the subscription; the publisher stops feeding taps of the topic when none is left."""
        self.on_close(self)

    @property
    def lost(self) -> int:
        """Returns how many messages this tap missed."""
        return sum(s.lost for s in self.subscribers)
