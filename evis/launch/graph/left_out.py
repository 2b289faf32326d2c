"""Lists what a graph leaves out, with the reasons, for `--explain` and for the report of a run."""

from __future__ import annotations

from collections.abc import Mapping

from evis.launch.graph.demand import Demand, is_open
from evis.launch.graph.wiring import WiredNode
from evis.runtime.plan import LeftOut, Plan
from msgs.camera import Keyframe
from msgs.topics import SYSTEM_TOPICS, find_topic

UNREAD = "nobody reads it; made only while somebody looks at it"
NEVER_MADE = "nobody reads it from the start; who comes later finds none"
ABSENT = " <- "
"""Between a node and a topic that it would take and nobody publishes, among what is left out."""


def left_out(
    nodes: list[WiredNode], chosen: list[WiredNode], demand: Demand, absent: Mapping[str, str]
) -> list[LeftOut]:
    """Lists everything that will not run or not be computed, with the reason. chosen: nodes that run or can be started
    later."""
    found = [LeftOut(name, reason) for name, reason in absent.items()]
    published = {topic for node in nodes for topic in node.outputs.values()}
    for node in nodes:
        topics = [node.among_all(t) for t in node.outputs.values() if t not in SYSTEM_TOPICS]
        if node.name not in demand.inputs:
            if node.joins:
                found.append(LeftOut(topics[0], UNREAD if node.open else NEVER_MADE))
            elif not node.spec.tap:
                late = "; started when a viewer opens it" if node.late and node in chosen else ""
                found.append(LeftOut(node.among_all(node.name), f"nobody reads {' or '.join(topics)}{late}"))
            continue
        for port, topic in node.outputs.items():
            if port not in demand.wanted[node.name] and topic not in SYSTEM_TOPICS and not find_topic(topic).latched:
                why = UNREAD if is_open(node, port, demand) else NEVER_MADE
                found.append(LeftOut(node.among_all(topic), why))
        found += [LeftOut(node.among_all(topic), why.partition(";")[0]) for topic, why in node.missing.items()]
        for port, topic in node.inputs.items():
            declared = node.cls.INPUTS[port]
            unpublished = topic not in published and topic not in SYSTEM_TOPICS
            given = declared.outside or (declared.needed and not unpublished)
            if port not in demand.inputs[node.name] and not given:
                found.append(LeftOut(f"{node.name}{ABSENT}{topic}", "nobody publishes it"))
        found += [LeftOut(what, why) for what, why in {**node.cls.imports(node.params), **node.spec.spares}.items()]
    return _merged(found)


def _merged(items: list[LeftOut]) -> list[LeftOut]:
    """Makes one line of what several nodes leave out alike, as the same package."""
    seen: dict[str, LeftOut] = {}
    for item in items:
        seen.setdefault(item.what, item)
    return list(seen.values())


def unmade(plan: Plan, chosen: list[WiredNode], demand: Demand) -> list[LeftOut]:
    """Lists the outputs that cannot be opened later, because their inputs are not connected."""
    return [
        LeftOut(f"{node.name} -> {topic}", "its inputs are not connected")
        for node in chosen
        if not node.part
        for port, topic in node.outputs.items()
        if topic not in SYSTEM_TOPICS and port not in plan.nodes[node.name].outputs and is_open(node, port, demand)
    ]


def colourless(plan: Plan) -> list[LeftOut]:
    """Lists the colour of the keyframes, where nobody reads it."""
    made = [topic for topic in plan.topics.values() if not plan.nodes[topic.node].dormant]
    keyframes = [topic for topic in made if topic.type == Keyframe.__name__]
    grey = [topic.name for topic in keyframes if topic.arrays is not None and "radiance" not in topic.arrays]
    if not grey:
        return []
    which = "keyframes" if len(grey) == len(keyframes) else f"keyframes of {', '.join(grey)}"
    return [LeftOut(which, "luminance only; nobody reads colour")]


def untaken(plan: Plan) -> dict[str, str]:
    """Lists the topics that nodes of a graph would take and that it was started without -> the node."""
    pairs = (item.what.partition(ABSENT) for item in plan.left_out if ABSENT in item.what)
    return {topic: node for node, _, topic in pairs}
