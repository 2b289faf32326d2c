"""Taps on demand: open while somebody looks and no longer, not tried again where refused, and nothing lost untold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

from evis.runtime.node import Node
from evis.runtime.plan import NodePlan, Plan, TopicPlan
from evis.web.taps_on_demand import TapsOnDemand
from msgs.header import Header, Message
from msgs.world import Clock


@dataclass
class Graph:
    """The part of the executor that opens taps; `open` are those there are now, `log` what was done."""

    plan: Plan
    open: dict[str, Any] = field(default_factory=dict)
    log: list[tuple[str, str]] = field(default_factory=list)
    gone: set[str] = field(default_factory=set)

    def open_tap(self, node: Any, topic: str, callback: Callable[[Message], None]) -> Any:
        if topic in self.gone:
            raise ValueError(f"{node.name}: nobody publishes {topic}")
        assert topic not in self.open, "a second tap of one topic"
        self.log.append(("open", topic))
        self.open[topic] = SimpleNamespace(callback=callback, lost=0, close=lambda: self._close(topic))
        return self.open[topic]

    def _close(self, topic: str) -> None:
        self.log.append(("close", topic))
        del self.open[topic]

    def request(self, topic: str) -> None:
        self.log.append(("wake", topic))


@dataclass
class Page:
    """Somebody who looks at `topics`."""

    topics: set[str] = field(default_factory=set)
    came: list[tuple[str, Message]] = field(default_factory=list)
    forgotten: list[str] = field(default_factory=list)
    reasons: dict[str, str] = field(default_factory=dict)

    def wanted(self) -> set[str]:
        return set(self.topics)

    def put(self, topic: str, message: Message) -> None:
        self.came.append((topic, message))

    def forget(self, topic: str) -> None:
        self.forgotten.append(topic)

    def refuse(self, topic: str, reason: str) -> None:
        assert topic not in self.reasons, "tried again"
        self.reasons[topic] = reason

    def refused(self, topic: str) -> bool:
        return topic in self.reasons


def made() -> tuple[Graph, Page, TapsOnDemand]:
    """A graph with depth, and labels of a node that sleeps."""
    plan = Plan("disk", "run-1", "", seed=1)
    for topic, node in (("/cam0/depth", "renderer"), ("/cam0/labels", "labeler")):
        plan.nodes[node] = NodePlan(node, "", {}, node, dormant=node == "labeler")
        plan.topics[topic] = TopicPlan(topic, topic[6:].capitalize(), node, topic[6:])
    graph, page = Graph(plan), Page()
    return graph, page, TapsOnDemand(cast(Node, SimpleNamespace(name="server", runtime=graph)), page)


def test_taps_are_open_while_somebody_looks() -> None:
    graph, page, taps = made()
    taps.update()
    assert graph.log == []
    page.topics = {"/cam0/depth", "/clock"}  # one that the plan lists, one of the system
    taps.update()
    taps.update()
    assert sorted(graph.log) == [("open", "/cam0/depth"), ("open", "/clock")] and page.forgotten == []
    messages = {topic: Clock(Header(7)) for topic in page.topics}
    for topic, message in messages.items():
        graph.open[topic].callback(message)
    assert {topic: came for topic, came in page.came} == messages
    page.topics = {"/clock"}
    taps.update()
    assert graph.open.keys() == {"/clock"} and page.forgotten == ["/cam0/depth"]
    taps.close()
    assert not graph.open and page.forgotten == ["/cam0/depth"]


def test_a_node_that_sleeps_is_woken_when_its_topic_is_tapped() -> None:
    graph, page, taps = made()
    page.topics = {"/cam0/labels"}
    taps.update()
    taps.update()
    assert graph.log == [("open", "/cam0/labels"), ("wake", "/cam0/labels")]


def test_what_is_refused_is_tried_again_only_when_the_refusal_is_over() -> None:
    graph, page, taps = made()
    page.topics, graph.gone = {"/cam0/depth"}, {"/cam0/depth"}
    taps.update()
    taps.update()
    assert page.reasons == {"/cam0/depth": "server: nobody publishes /cam0/depth"} and graph.log == []
    graph.gone.clear()
    taps.update()
    assert graph.log == []
    page.reasons.clear()
    taps.update()
    assert graph.open.keys() == {"/cam0/depth"}


def test_each_lost_message_is_told_once() -> None:
    """Those of a tap that is closed in the same round too; of one opened again it begins at none."""
    graph, page, taps = made()
    page.topics = {"/cam0/depth", "/clock"}
    taps.update()
    assert list(taps.lost()) == []
    graph.open["/cam0/depth"].lost = 3
    assert list(taps.lost()) == [("/cam0/depth", 3)] and list(taps.lost()) == []
    graph.open["/cam0/depth"].lost, graph.open["/clock"].lost = 4, 2
    page.topics = set()
    assert sorted(taps.lost()) == [("/cam0/depth", 1), ("/clock", 2)]
    taps.update()
    page.topics = {"/cam0/depth"}
    taps.update()
    graph.open["/cam0/depth"].lost = 1
    assert list(taps.lost()) == [("/cam0/depth", 1)]
