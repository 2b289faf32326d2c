"""Computes how often each node publishes, to find a loop that would wait for ever before anything starts."""

from __future__ import annotations

import math
from collections.abc import Mapping

from evis.config.document import LaunchError
from evis.launch.graph.wiring import Wired
from evis.runtime.plan import Plan
from msgs.topics import find_topic


def check_pace(plan: Plan, nodes: Mapping[str, Wired]) -> None:
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
            if topic in plan.topics and _joined(node, port, topic)
        ]
        paces[name] = math.lcm(*above) * (1 if node.cls.SOURCE else node.divides)
    for topic in plan.topics.values():
        for edge in topic.edges:
            if edge.node in nodes and nodes[edge.node].cls.INPUTS[edge.port].delayed:
                _check(nodes[edge.node], topic.node, topic.name, paces.get(topic.node, 1))


def _joined(node: Wired, port: str, topic: str) -> bool:
    declared = node.cls.INPUTS[port]
    return declared.join and not declared.delayed and port != node.any_port and not find_topic(topic).latched


def _check(source: Wired, publisher: str, topic: str, pace: int) -> None:
    held = source.divides
    if held % pace:
        raise LaunchError(
            f"{source.spec.where}: '{source.name}' waits for {topic} once in {held} of its messages, but '{publisher}' "
            f"publishes it once in {pace}, as slow as a camera that it reads; give action_rate:=HZ, that camera's rate"
        )
