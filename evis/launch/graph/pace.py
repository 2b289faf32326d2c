"""Computes how often each node publishes, to find a loop that would wait for ever before anything starts."""

from __future__ import annotations

import math
from collections.abc import Mapping

from evis.config.document import LaunchError
from evis.launch.graph.wiring import WiredNode
from evis.runtime.plan import Plan


def check_pace(plan: Plan, nodes: Mapping[str, WiredNode]) -> None:
    """Raises LaunchError where a source waits for more messages on a delayed input than its publisher makes.

    nodes: those of the plan, which is in data-flow order, by name.
    """
    paces: dict[str, int] = {}
    """Node -> steps of the source to one of its messages."""
    for name, planned in plan.nodes.items():
        if name not in nodes:
            continue
        node = nodes[name]
        above = [
            paces.get(plan.topics[topic].node, 1)
            for port, topics in planned.inputs.items()
            for topic in topics
            if topic in plan.topics and node.cls.INPUTS[port].joins(topic)
        ]
        paces[name] = math.lcm(*above) * (1 if node.cls.SOURCE else node.divides)
    for topic in plan.topics.values():
        for edge in topic.edges:
            if edge.node in nodes and nodes[edge.node].cls.INPUTS[edge.port].delayed:
                _check(nodes[edge.node], topic.node, topic.name, paces.get(topic.node, 1))


def _check(source: WiredNode, publisher: str, topic: str, pace: int) -> None:
    steps = source.divides
    if steps % pace:
        raise LaunchError(
            f"{source.spec.where}: '{source.name}' waits for {topic} once in {steps} of its messages, but "
            f"'{publisher}' publishes it once in {pace}, as slow as a camera that it reads; give action_rate:=HZ, that "
            "camera's rate"
        )
