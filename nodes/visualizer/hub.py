"""Connects the executor's thread with the server's: who has which panel open, and the newest of each.

The server's side says what its clients want; the node's `idle` opens and closes taps until they match. Messages come
in on the executor's thread, are copied into views, and wake the clients. Nothing here ever waits for a client.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from evis.runtime.plan import Plan
from evis.web.notices import Notices
from msgs.header import Message
from msgs.topics import SYSTEM_TOPICS
from nodes.visualizer import catalog
from nodes.visualizer.statistics import Statistics
from nodes.visualizer.views.part import TopicView

MAX_PANELS = 64
"""Panels per client."""
MAX_VIEWS = 256
"""Different panels of all clients together: each holds the newest message of its topic."""


class PanelKey(NamedTuple):
    """Names what a panel shows. Clients with the same key share one view and its encoded parts."""

    topic: str
    view: str
    env: int


class Hub(Notices):
    """Holds the shared state; every method is safe from any thread."""

    def __init__(self, plan: Plan, quality: int) -> None:
        super().__init__()
        self.plan = plan
        self.statistics = Statistics({name for name, topic in plan.topics.items() if topic.latched})
        self._quality = quality
        self._views: dict[PanelKey, TopicView] = {}
        self._by_topic: dict[str, list[TopicView]] = {}
        self._clients: dict[object, frozenset[PanelKey]] = {}
        self._wakers: dict[object, Callable[[], None]] = {}
        self._refused: dict[str, str] = {}
        self._latched: dict[str, Message] = {}
        self._state = "running"
        self.failure = ""
        """What ended the graph before its time; empty where nothing did."""

    # -- the server's side -------------------------------------------------------------------------------------------

    def join(self, client: object, wake: Callable[[], None]) -> None:
        """Adds a client; `wake` is called, from any thread, whenever there is news."""
        with self._lock:
            self._clients[client] = frozenset()
            self._wakers[client] = wake

    def show(self, client: object, keys: frozenset[PanelKey]) -> None:
        """Sets the panels that a client has open. Raises ValueError for one that cannot be."""
        if len(keys) > MAX_PANELS:
            raise ValueError(f"{len(keys)} panels, the most is {MAX_PANELS}")
        for key in keys:
            if key.topic not in self.plan.topics:
                raise ValueError(f"this graph has no topic '{key.topic}'")
            self._make_view(key)
        with self._lock:
            others = frozenset().union(*(shown for c, shown in self._clients.items() if c != client))
            if len(keys | others) > MAX_VIEWS:
                raise ValueError(f"{len(keys | others)} different panels on all pages, the most is {MAX_VIEWS}")
            if client in self._clients:
                self._clients[client] = keys
                self._reconcile()

    def leave(self, client: object) -> None:
        """Removes a client; its panels close unless another one has them open."""
        with self._lock:
            self._clients.pop(client, None)
            self._wakers.pop(client, None)
            self._reconcile()

    def _reconcile(self) -> None:
        wanted = frozenset().union(*self._clients.values())
        for key in [k for k in self._views if k not in wanted]:
            del self._views[key]
        for key in wanted - self._views.keys():
            view = self._make_view(key)
            if key.topic in self._latched:
                view.capture(self._latched[key.topic])
            self._views[key] = view
        self._by_topic = {}
        for key, view in self._views.items():
            self._by_topic.setdefault(key.topic, []).append(view)
        for topic in [t for t in self._refused if t not in self._by_topic]:
            del self._refused[topic]

    def _make_view(self, key: PanelKey) -> TopicView:
        alone = catalog.environment_of(key.topic)  # whichever a page asks for, no other one will come
        env = key.env if alone is None else alone
        return catalog.make_view(self.plan.topics[key.topic].type, key.view, env, self._quality)

    def view(self, key: PanelKey) -> TopicView | None:
        """Returns the view of an open panel."""
        with self._lock:
            return self._views.get(key)

    def status(self) -> dict[str, Any]:
        """Returns rates, node states and refused topics."""
        with self._lock:
            extra = {
                "state": self._state,
                "failure": self.failure,
                "clients": len(self._clients),
                "refused": dict(self._refused),
            }
        return {**self.statistics.snapshot(), **extra}

    # -- the executor's side -----------------------------------------------------------------------------------------

    def wanted(self) -> set[str]:
        """Names the topics to be tapped now: those of open panels, and the system's while anybody looks."""
        with self._lock:
            if not self._clients:
                return set()
            return set(self._by_topic) | set(SYSTEM_TOPICS)

    def forget(self, topic: str) -> None:
        """Notes that a topic is no longer tapped: what comes until it is tapped again was not missed."""
        self.statistics.forget(topic)

    def put(self, topic: str, message: Message) -> None:
        """Takes a message of a tap. Copies what the open panels need; costs nothing for topics nobody has open."""
        self.statistics.saw(topic, message)
        latched = topic in self.plan.topics and self.plan.topics[topic].latched
        with self._lock:
            if latched:  # it comes once, but a panel may open later
                self._latched[topic] = _copy(message)
            views = list(self._by_topic.get(topic, ()))
        for view in views:
            try:
                view.capture(message)
            except Exception as error:
                self.refuse(topic, f"{type(error).__name__}: {error}")
        if views:
            self._wake()

    def refuse(self, topic: str, reason: str) -> None:
        """Notes that a topic cannot be shown; the page says so, and the node warns once."""
        with self._lock:
            known = self._refused.get(topic)
            self._refused[topic] = reason
        if known != reason:
            self.report(f"{topic} cannot be shown: {reason}")

    def refused(self, topic: str) -> bool:
        """Says whether a topic was refused since its last panel was closed."""
        with self._lock:
            return topic in self._refused

    def finish(self, failure: str = "") -> None:
        """Tells the clients that the graph has ended, of itself or by a failure, before the server goes."""
        with self._lock:
            self._state, self.failure = "finished", failure
        self._wake()

    def _wake(self) -> None:
        with self._lock:
            wakers = list(self._wakers.values())
        for wake in wakers:
            wake()


def _copy(message: Message) -> Message:
    arrays = {name: np.array(value) for name, value in message.arrays().items()}
    return type(message)(message.header, **arrays, **message.scalars())  # type: ignore[call-arg]
