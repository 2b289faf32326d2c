"""Opens and closes the taps of a node as those whom its server shows the graph to come and go."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

from msgs.header import Message

if TYPE_CHECKING:
    from evis.runtime.node import Node
    from evis.runtime.tap import TapSubscription


class Audience(Protocol):
    """Knows which topics somebody looks at, and takes their messages."""

    def wanted(self) -> set[str]:
        """Names the topics to be tapped now."""

    def put(self, topic: str, message: Message) -> None:
        """Takes a message of a tap; its arrays are not used after return."""

    def forget(self, topic: str) -> None:
        """Notes that a topic is no longer tapped."""

    def refuse(self, topic: str, reason: str) -> None:
        """Notes that a topic cannot be tapped."""

    def refused(self, topic: str) -> bool:
        """Tells whether a topic was refused, so that it is not tried again."""


class TapsOnDemand:
    """Holds the taps of a node, one for each topic that its audience wants. Of the executor's thread alone."""

    def __init__(self, node: Node, audience: Audience) -> None:
        self._node, self._audience = node, audience
        self._open: dict[str, TapSubscription] = {}
        self._lost: dict[str, int] = {}

    def lost(self) -> Iterator[tuple[str, int]]:
        """Yields each tapped topic of which messages were missed since the last call, and how many; before `update`,
        which closes taps, so that none is left out.
        """
        for topic, tap in self._open.items():
            lost, before = tap.lost, self._lost.get(topic, 0)
            if lost > before:
                self._lost[topic] = lost
                yield topic, lost - before

    def update(self) -> None:
        """Closes the taps that are no longer wanted, and opens those that are; wakes the node that publishes a topic
        where it sleeps.
        """
        wanted = self._audience.wanted()
        for topic in self._open.keys() - wanted:
            self._open.pop(topic).close()
            self._lost.pop(topic, None)
            self._audience.forget(topic)
        for topic in wanted - self._open.keys():
            if not self._audience.refused(topic):
                self._tap(topic)

    def _tap(self, topic: str) -> None:
        runtime, put = self._node.runtime, self._audience.put
        plan = runtime.plan
        publisher = plan.nodes.get(plan.topics[topic].node) if topic in plan.topics else None
        try:
            self._open[topic] = runtime.open_tap(self._node, topic, lambda message: put(topic, message))
            if publisher is not None and publisher.dormant:
                runtime.request(topic)
        except (ValueError, OSError) as error:
            self._audience.refuse(topic, str(error))

    def close(self) -> None:
        """Closes all taps; the audience, whose server ends too, is told nothing."""
        for tap in self._open.values():
            tap.close()
        self._open = {}
