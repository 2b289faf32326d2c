"""Reads a topic of a running graph from another program, by a tap, which can slow nobody but for the copies it asks."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zmq

from evis.bus import Subscriber, endpoints_for
from evis.client.running import check_topic, lives
from evis.runtime.hosting.wiring import system_topic
from evis.runtime.plan import Plan
from evis.runtime.process.control import ask_for
from msgs.header import Message
from msgs.topics import SYSTEM_TOPICS, find_topic

_LOOK_MS = 100
"""Longest time between two looks at whether the graph still runs."""
_CONNECTION_S = 1.0
"""Longest wait for the publishers of a topic, which are there from the start of the graph."""


class TopicReader:
    """Iterates over the messages of one topic, as they come, until the graph ends.

    Arrays are numpy's and the reader's own: they stay as they are. What comes faster than it is read is lost, and
    counted in `lost`: the oldest first, unless a program neither reads nor acts until the queues are full.
    """

    def __init__(self, plan: Plan, topic: str, *, every: bool = True) -> None:
        """Begins to read.

        Args:
            plan: of the running graph.
            topic: its name, as `/cam0/events`.
            every: every message, as a program wants them; otherwise at the rate of a screen, as `evis topic echo`.

        Raises:
            ValueError: the graph has no such topic.
        """
        self.topic = check_topic(plan, topic)
        self.arrived_at = 0.0
        """time.monotonic() at which the last message came."""
        self.sender = ""
        """Publisher of the last message: every process has one of a system topic, which numbers its messages itself."""
        self._plan = plan
        self._context, self._poller = zmq.Context(), zmq.Poller()
        self._subscribers: dict[Subscriber, str] = {}
        self._lost = 0
        names, self._later = [topic], set[str]()
        if topic in SYSTEM_TOPICS:
            names = [system_topic(topic, process) for process in sorted({n.process for n in plan.nodes.values()})]
            self._later = set(names) - {system_topic(topic, process) for process in plan.processes()}
        elif plan.nodes[plan.topics[topic].node].dormant:
            ask_for(plan.directory, topic)
        for name in names:
            where, kind = endpoints_for(plan.directory, name), find_topic(topic).type
            subscriber = Subscriber(
                self._context, topic, "client", "tap", where, message_type=kind, tap=True, every=every
            )
            subscriber.start()
            self._poller.register(subscriber.socket, zmq.POLLIN)
            self._subscribers[subscriber] = name
        self._wait_for_connections()

    def _wait_for_connections(self) -> None:
        """What the caller asks of the graph from now on comes after its subscription, so nothing of it is missed.

        A process that starts on demand, and has not, is not waited for: the others' messages would grow old meanwhile.
        """
        there = [
            subscriber
            for subscriber, name in self._subscribers.items()
            if name not in self._later or Path(subscriber.endpoints.tap.removeprefix("ipc://")).exists()
        ]
        deadline = time.monotonic() + _CONNECTION_S
        while time.monotonic() < deadline and not all(s.connected() for s in there):
            time.sleep(0.001)

    @property
    def lost(self) -> int:
        """Returns how many messages were missed since the first one, by their sequence numbers."""
        return self._lost + sum(s.lost for s in self._subscribers)

    @property
    def ended(self) -> bool:
        """Says whether the graph has said that nothing more comes."""
        return not self._subscribers

    def read(self, timeout_s: float | None = None) -> Any:
        """Returns the next message.

        Args:
            timeout_s: longest wait [s]; None = until the graph ends.

        Returns:
            A message of the topic's type, with arrays of its own; None when none came, or the graph has ended.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        live = True
        while True:
            if (message := self._receive()) is not None:
                return message
            left_ms = _LOOK_MS if deadline is None else min(_LOOK_MS, int(1e3 * (deadline - time.monotonic())) + 1)
            if self.ended or not live or left_ms <= 0:
                return None
            if not self._poller.poll(left_ms):
                live = lives(self._plan)  # and then once more: what it sent last may have come since

    def _receive(self) -> Message | None:
        for subscriber, name in list(self._subscribers.items()):
            message = subscriber.receive(0)
            if isinstance(message, Message):
                self.arrived_at, self.sender = time.monotonic(), name
                own = {name: np.array(array) for name, array in message.arrays().items()}
                return dataclasses.replace(message, **own)  # type: ignore[type-var]
            if message is not None:
                self._forget(subscriber)
        return None

    def make_room(self) -> None:
        """Drops the oldest messages that were not read where there are too many, so that the newest find room."""
        for subscriber in self._subscribers:
            subscriber.make_room()

    def _forget(self, subscriber: Subscriber) -> None:
        self._lost += subscriber.lost
        self._poller.unregister(subscriber.socket)
        del self._subscribers[subscriber]
        subscriber.close()

    def close(self) -> None:
        """Ends the reading; the graph makes no more copies for it."""
        for subscriber in list(self._subscribers):
            self._forget(subscriber)
        self._context.destroy(linger=0)

    def __iter__(self) -> Iterator[Any]:
        """Yields messages until the graph ends."""
        while (message := self.read()) is not None:
            yield message

    def __enter__(self) -> TopicReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
