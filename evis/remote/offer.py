"""Chooses what is offered of a graph: the part of its plan that followers are told."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from evis.runtime.plan import LeftOut, Plan
from msgs.topics import SYSTEM_TOPICS


def offered(plan: Plan, topics: Collection[str]) -> Plan:
    """Returns a plan with these topics and those of the system alone; of the others it says why they are not there."""
    kept = {*topics, *SYSTEM_TOPICS}
    nodes = {}
    for name, node in plan.nodes.items():
        inputs = {port: [topic for topic in read if topic in kept] for port, read in node.inputs.items()}
        outputs = {port: topic for port, topic in node.outputs.items() if topic in kept}
        nodes[name] = dataclasses.replace(
            node, inputs={port: read for port, read in inputs.items() if read}, outputs=outputs
        )
    why = "`evis remote serve` there does not offer it; its --topics does"
    not_offered = [LeftOut(topic, why) for topic in plan.open_topics() if topic not in kept]
    return dataclasses.replace(
        plan, nodes=nodes, topics={name: topic for name, topic in plan.topics.items() if name in kept},
        left_out=[*not_offered, *plan.left_out],
    )  # fmt: skip
