"""Adds a node to the plan of a graph that runs already."""

from __future__ import annotations

import fnmatch
from pathlib import Path

from evis.config.document import LaunchError
from evis.launch.expand import NodeSpec
from evis.launch.graph.demand import Pruner, globs_of
from evis.launch.graph.wiring import WiredNode, wire
from evis.runtime.plan import Edge, NodePlan, Plan, TopicPlan
from msgs.camera import Image
from msgs.topics import SYSTEM_TOPICS, find_topic


def attach(plan: Plan, spec: NodeSpec, folder: Path) -> None:
    """Adds one node to the plan of a running graph: its inputs are taps, its process is its own.

    Raises LaunchError when the graph lacks a topic that it reads, or has one that it would publish.
    """
    node = wire(spec, folder)
    for topic in node.outputs.values():
        if topic in plan.topics:
            raise LaunchError(
                f"{spec.type} would publish {topic}, which {plan.topics[topic].node} of the running graph publishes; "
                "a topic has one publisher: start the graph without that node, or give this one's topic another name "
                "by `remap` in a launch file"
            )
    available = {name: (node, "") for name in plan.open_topics() if name not in _unmade_images(plan, node)}
    demand = Pruner([node], available).attached(node)
    planned = NodePlan(node.name, node.target, node.params, spec.process, demand.inputs[node.name])
    planned.outputs = dict(node.outputs)
    plan.nodes[node.name] = planned
    plan.secrets += node.secrets
    for port, topic in planned.outputs.items():
        plan.topics[topic] = TopicPlan(topic, find_topic(topic).type.__name__, node.name, port)
    for port, topics in planned.inputs.items():
        for topic in topics:
            if topic not in SYSTEM_TOPICS:
                plan.topics[topic].edges.append(Edge(node.name, port, "tap"))


def _unmade_images(plan: Plan, node: WiredNode) -> set[str]:
    """Images that a running graph could make and does not: for who is not told to take them there are none, so that a
    recorder makes its preview.
    """
    if node.any_port is None:
        return set()
    dormant = {topic for other in plan.nodes.values() if other.dormant for topic in other.outputs.values()}
    images = {topic for topic in dormant & plan.topics.keys() if plan.topics[topic].type == Image.__name__}
    return images - {topic for glob in globs_of(node) for topic in fnmatch.filter(images, glob)}
