"""Records a running graph by taps on its topics, so that it can slow nobody; what it missed is counted."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from evis.runtime.plan import Plan
from msgs.header import Message
from msgs.topics import find_topic

POLL_MS = 50


class Taps:
    """Holds lossy subscriptions to topics of one running graph."""

    def __init__(self, plan: Plan, topics: list[str]) -> None:
        import zmq

        from evis.bus import Subscriber, endpoints_for

        self._context = zmq.Context()
        self._poller = zmq.Poller()
        self._subscribers: dict[str, Any] = {}
        for topic in topics:
            subscriber = Subscriber(
                self._context, topic, "recorder", "tap", endpoints_for(plan.directory, topic),
                message_type=find_topic(topic).type, tap=True,
            )  # fmt: skip
            subscriber.start()
            self._poller.register(subscriber.socket, zmq.POLLIN)
            self._subscribers[topic] = subscriber

    def run(self, receive: Callable[[str, Message], None], duration_s: float | None, alive: Callable[[], bool]) -> None:
        """Receives messages until `duration_s` is over, the graph is gone or all topics have ended."""
        from evis.bus import END

        ending = None if duration_s is None else time.monotonic() + duration_s
        open_topics = set(self._subscribers)
        while open_topics and alive() and (ending is None or time.monotonic() < ending):
            self._poller.poll(POLL_MS)
            for topic in list(open_topics):
                while (message := self._subscribers[topic].receive(0)) is not None:
                    if message is END:
                        open_topics.discard(topic)
                        break
                    receive(topic, message)
                    message.release()

    def close(self) -> None:
        """Closes the sockets."""
        for subscriber in self._subscribers.values():
            subscriber.close()
        self._context.destroy(linger=0)
