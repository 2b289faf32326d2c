"""Defines the errors that the bus raises."""

from __future__ import annotations


class BusError(OSError):
    """Reports a transport failure; the text names the topic and the remedy."""


class PeerLost(BusError):
    """Reports that the other end of a topic died, froze or left before the end of the stream.

    node: who is gone (a node, or `node:port` for a consumer). topic: what it was publishing or reading.
    """

    def __init__(self, node: str, topic: str, how: str = "is gone: it died, froze or left before the end") -> None:
        super().__init__(f"{node} {how} (topic {topic}); see its log")
        self.node = node
        self.topic = topic
        self.how = how

    def __reduce__(self) -> tuple[type[PeerLost], tuple[str, str, str]]:
        return PeerLost, (self.node, self.topic, self.how)
