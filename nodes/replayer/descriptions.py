"""Keeps the descriptions of cameras (CameraInfo) that hold as a round of a replay begins.

A description is recorded once, and again where it changes. A replay that begins later in the bag, or plays it again,
needs the one that held there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from msgs.header import Message

if TYPE_CHECKING:
    from evis.bag.reader import BagReader


def _order_of(message: Message) -> tuple[int, int, int]:
    """Gives what sorts the messages of a topic as they were recorded."""
    return *message.header.instant, message.header.seq


def description_at(reader: BagReader, topic: str, start: int, episode: int) -> Message | None:
    """Finds the last description of a camera up to where a replay begins; the first of all where there is none.

    start: stamp [ns], and episode, of the first message that is played.
    """
    last = None
    for _, info in reader.messages([topic], None, start):
        if info.header.episode > episode:
            break
        last = info
    return next(reader.messages([topic]), (topic, None))[1] if last is None else last


class Descriptions:
    """Keeps, by topic, the descriptions that hold as a round begins, and which of them others have replaced since."""

    def __init__(self, at_start: Mapping[str, Message]) -> None:
        """at_start: topic -> the description that holds as a round begins."""
        self.at_start = dict(at_start)
        self._orders = {topic: _order_of(message) for topic, message in self.at_start.items()}
        self._replaced: set[str] = set()

    def covers(self, topic: str, message: Message) -> bool:
        """Tells whether a message is a description of before a round begins, of which the last one was published."""
        return topic in self._orders and _order_of(message) <= self._orders[topic]

    def passed(self, topic: str) -> None:
        """Notes that a message of a topic was published; a description replaces the one that held before."""
        if topic in self._orders:
            self._replaced.add(topic)

    def restart(self) -> list[str]:
        """Begins another round: gives the topics whose description must be published again."""
        replaced, self._replaced = sorted(self._replaced), set()
        return replaced
