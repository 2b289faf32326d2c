"""Connects the nodes of a plan by their topics: who reads what, how, and in which order that makes them run."""

from __future__ import annotations

from collections.abc import Mapping

from evis.launch.graph.order import data_flow_order
from evis.launch.graph.wiring import WiredNode
from evis.runtime.plan import Edge, NodePlan, Plan, TopicPlan
from msgs.fields import by_environment
from msgs.topics import SYSTEM_TOPICS, find_topic


def connect(plan: Plan, chosen: list[WiredNode]) -> None:
    """Fills in the topics of a plan, with an edge for each of their readers. chosen: the nodes of the plan."""
    for planned in plan.nodes.values():
        for port, topic in planned.outputs.items():
            row = find_topic(topic)
            plan.topics[topic] = TopicPlan(topic, row.type.__name__, planned.name, port, latched=row.latched)
    for node in chosen:
        planned = plan.nodes[node.name]
        if node.spec.tap:
            planned.inputs |= {p: [t] for p, t in node.inputs.items() if t in plan.topics or t in SYSTEM_TOPICS}
        for port, topics in planned.inputs.items():
            for topic in topics:
                if topic not in SYSTEM_TOPICS:
                    kind, hz = _kind(node, port, topic, planned), _arrays_hz(node, port, topic, planned)
                    plan.topics[topic].edges.append(Edge(node.name, port, kind, hz))
    wired = {node.name: node for node in chosen}
    for name in plan.topics:
        plan.topics[name].arrays = _read_arrays(plan, name, wired)


def _arrays_hz(node: WiredNode, port: str, topic: str, planned: NodePlan) -> float | None:
    """Tells how often a node reads arrays of a topic, of one whose messages can be sent with none."""
    if not by_environment(find_topic(topic).type):
        return None
    return node.cls.arrays_hz(planned.params, node.port_of(port, topic))


def _read_arrays(plan: Plan, topic: str, wired: Mapping[str, WiredNode]) -> list[str] | None:
    """Lists arrays that the declared consumers of a topic need; None where one takes all, or there is none."""
    declared = [edge for edge in plan.topics[topic].edges if edge.kind != "tap"]
    ports = [wired[edge.node].port_of(edge.port, topic) for edge in declared]
    read = [wired[edge.node].cls.reads(plan.nodes[edge.node].params, port) for edge, port in zip(declared, ports)]
    known = [arrays for arrays in read if arrays is not None]
    return sorted(frozenset().union(*known)) if known and len(known) == len(read) else None


def _kind(node: WiredNode, port: str, topic: str, planned: NodePlan) -> str:
    if node.spec.tap or planned.dormant or not find_topic(topic).lockstep:
        return "tap"
    return "lockstep" if node.cls.INPUTS[port].needed else "delayed"


def in_data_flow_order(plan: Plan) -> dict[str, NodePlan]:
    """Sorts the nodes of a plan so that publishers stand before their consumers. Raises LaunchError for a cycle."""
    edges: dict[str, list[tuple[str, str]]] = {}
    for topic in plan.topics.values():
        edges.setdefault(topic.node, []).extend((e.node, topic.name) for e in topic.edges if e.kind == "lockstep")
    return {name: plan.nodes[name] for name in data_flow_order(list(plan.nodes), edges)}
