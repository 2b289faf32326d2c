"""Decides whether somebody waits for each keyframe of a graph, or nodes may make several at once (`batch`)."""

from __future__ import annotations

from collections.abc import Sequence

from evis.config.document import LaunchError
from evis.launch.graph.wiring import WiredNode
from evis.runtime.plan import Plan

BATCH = "batch"
"""Parameter of nodes that can process several keyframes at once: how many, 0 = as many as make them faster."""
SEVERAL_PROCESSES = "its nodes run as several processes (--compose makes them one)"


def who_waits(plan: Plan, nodes: Sequence[WiredNode], stepped: bool) -> tuple[str, str]:
    """Says why somebody waits for what comes of each keyframe of a graph, and why every keyframe is made by itself,
    which has the same reason or another; "" where nobody does, and where several may be made at once.

    A program outside that can publish to a delayed input, such as /action, may wait for keyframes. In the process that
    has this input nodes make several at once until one does (`Node.take_singly`), and not again when it has left, for
    it may come again. Where the user asks for several at once, these inputs are taken out of the plan, so that no
    program outside can.

    Args:
        plan: of the graph; `outside` of its nodes is changed.
        nodes: those of the plan.
        stepped: the caller steps the graph (`evis.Simulation`).

    Raises LaunchError where several keyframes at once are asked for, and somebody waits for each, or where there are
    several environments.
    """
    asked, awake = [node for node in nodes if (node.params.get(BATCH) or 0) > 1], _awake(plan, nodes)
    for node in asked:
        if (envs := node.params.get("envs") or 1) > 1:
            raise LaunchError(
                f"{node.spec.where}: {BATCH}:={node.params[BATCH]} with envs:={envs}: environments are a batch "
                "already; leave one out"
            )
    waits = _waits(plan, stepped)
    single = waits or ("" if _in_one_process(plan, awake) else SEVERAL_PROCESSES)
    if single and not waits and any(node.divides > 1 for node in awake if not node.cls.SOURCE):
        # Who joins events of a slow camera with every state has no room for those until the next events.
        waits = "its cameras have several rates in several processes"
    if asked and single:
        node = asked[0]
        raise LaunchError(
            f"{node.spec.where}: {BATCH}:={node.params[BATCH]} makes several keyframes at once, but {single}"
        )
    for node in nodes:
        ports = [port for port in plan.nodes[node.name].outside if node.cls.INPUTS[port].delayed]
        if not ports or not node.cls.moved_from_outside(node.params):
            continue  # who asks is told that there is nothing to move
        if asked:
            for port in ports:
                del plan.nodes[node.name].outside[port]
        elif not waits:
            # The process that it comes to knows when it does, and has its own nodes take one keyframe at a time then.
            waits = f"a program outside may give {plan.nodes[node.name].outside[ports[0]]}"
            there = {plan.nodes[other.name].process for other in awake if BATCH in other.params}
            single = single or ("" if there == {plan.nodes[node.name].process} else waits)
    return waits, single


def _waits(plan: Plan, stepped: bool) -> str:
    """Says why somebody in the graph, or who holds it, waits for each keyframe; "" where nobody does."""
    if stepped:
        return "its caller takes one step at a time"
    if plan.mode != "lockstep":
        return f"a {plan.mode} graph keeps the pace of the clock"
    closed = [topic.name for topic in plan.topics.values() if any(edge.kind == "delayed" for edge in topic.edges)]
    return f"{closed[0]} closes the loop" if closed else ""


def _awake(plan: Plan, nodes: Sequence[WiredNode]) -> list[WiredNode]:
    return [node for node in nodes if not node.spec.tap and not plan.nodes[node.name].dormant]


def _in_one_process(plan: Plan, awake: Sequence[WiredNode]) -> bool:
    """Tells whether one process makes all that several keyframes at once go through, and others only take of it.

    A process takes a message of a topic when it has room. One that joins two topics may wait for the second with no
    room for more of the first, of which several come before it; and what leads back keeps those waiting that it is for.
    """
    process = {node.name: plan.nodes[node.name].process for node in awake}
    making = {process[node.name] for node in awake if BATCH in node.params}
    if len(making) != 1:
        return len(set(process.values())) == 1
    inside = {name for name, of in process.items() if of in making}
    for node in awake:
        read = [t for t in plan.topics.values() if any(e.node == node.name and e.kind == "lockstep" for e in t.edges)]
        if node.name in inside:
            if any(topic.node not in inside for topic in read):
                return False
        elif sum(_joins(node, topic.name) for topic in read) > 1:
            return False
    return True


def _joins(node: WiredNode, topic: str) -> bool:
    """Tells whether a node takes messages of a topic together with those of others."""
    return any(node.cls.INPUTS[port].joins(topic) for port, name in node.inputs.items() if name == topic)
