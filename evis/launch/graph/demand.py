"""Finds what a graph needs, from its sinks back to its sources, and leaves out the rest."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from evis.config.document import LaunchError
from evis.config.suggestions import nearest
from evis.launch.graph.wiring import Wired
from evis.runtime.plan import LeftOut, Plan
from msgs.topics import SYSTEM_TOPICS, find_topic

UNREAD = "nobody reads it; made only while somebody looks at it"
NEVER_MADE = "nobody reads it from the start; who comes later finds none"
ABSENT = " <- "
"""Between a node and a topic that it would take and nobody publishes, among what is left out."""


@dataclass
class Demand:
    """Holds what is read: wanted output ports and connected inputs (port -> topics) of every node that is needed."""

    wanted: dict[str, set[str]] = field(default_factory=dict)
    inputs: dict[str, dict[str, list[str]]] = field(default_factory=dict)


class Pruner:
    """Follows the demand for outputs upstream until nothing changes.

    partial: there are nodes that were not loaded, so a topic without a publisher is no error.
    """

    def __init__(
        self, nodes: list[Wired], publishers: Mapping[str, tuple[Wired, str]], *, partial: bool = False
    ) -> None:
        self._nodes = nodes
        self._partial = partial
        self._publishers = publishers
        self.demand = Demand()

    def run(self) -> Demand:
        """Follows sinks and kept outputs first, then those that take what they are told, by name and at last by
        default.
        """
        sinks = [n for n in self._nodes if not n.spec.tap and not n.spec.on_demand]
        for node in sinks:
            if node.spec.keep or (not node.outputs and node.any_port is None):
                self._need(node, set(node.spec.keep))
        for node in (n for n in self._nodes if n.spec.on_demand and n.spec.keep):
            self._need(node, set(node.spec.keep))
        readers = [n for n in sinks if n.any_port is not None]
        for node in readers:
            for topic in self._named(node) & set(self._chosen(node)):
                self._want(topic)
        for node in readers:
            self._read(node)
        return self.demand

    def attached(self, node: Wired) -> Demand:
        """Returns what one node reads of topics that are there already, whoever publishes them."""
        inputs = self.demand.inputs.setdefault(node.name, {})
        for port in node.needs(node.outputs) & node.inputs.keys():
            if node.inputs[port] in self._publishers or node.inputs[port] in SYSTEM_TOPICS:
                inputs[port] = [node.inputs[port]]
            elif node.cls.INPUTS[port].needed:
                raise self._unpublished(node, node.inputs[port])
        if node.any_port is not None:
            inputs[node.any_port] = self._chosen(node)
        return self.demand

    def _unpublished(self, node: Wired, topic: str) -> LaunchError:
        remedies = {source.cls.REMEDY.format(topic=topic) for source in self._nodes if source.cls.REMEDY}
        remedy = "; ".join(sorted(remedies)) or nearest(topic, self._publishers)
        return LaunchError(f"{node.spec.where}: '{node.name}' reads {topic}, which nobody publishes; {remedy}")

    def _need(self, node: Wired, ports: set[str]) -> None:
        wanted = self.demand.wanted.setdefault(node.name, set())
        first = node.name not in self.demand.inputs
        if not first and ports <= wanted:
            return
        wanted |= ports
        inputs = self.demand.inputs.setdefault(node.name, {})
        needed = node.needs(wanted)
        for port in node.inputs:
            if port in needed and port not in inputs:
                topic = node.inputs[port]
                if topic not in SYSTEM_TOPICS and topic not in self._publishers:
                    if not node.cls.INPUTS[port].needed or self._partial:
                        continue
                    raise self._unpublished(node, topic)
                inputs[port] = [topic]
                self._want(topic)

    def _want(self, topic: str) -> None:
        if topic not in SYSTEM_TOPICS:
            publisher, port = self._publishers[topic]
            self._need(publisher, {port})

    def _read(self, node: Wired) -> None:
        """Connect a reader of whatever it is told."""
        topics = self._chosen(node)
        self._need(node, set())
        self.demand.inputs[node.name][node.any_port or ""] = topics
        for topic in topics:
            self._want(topic)

    def _chosen(self, node: Wired) -> list[str]:
        """What such a reader takes: its class says so, or `topics` are globs, or all that is recorded.

        What is made on demand is read by default only where somebody has demanded it already.
        """
        globs, named = globs_of(node), self._named(node)
        available = [t for t in self._available(node) if t in named or self._by_default(t)]
        choose = getattr(node.cls, "dynamic_inputs", None)
        if choose is not None:
            params = dict(node.params)
            if self._partial and globs:
                params["topics"] = [g for g in globs if fnmatch.filter(available, g)]
            try:
                topics = list(choose(params, available))
            except (ValueError, OSError) as error:
                raise LaunchError(f"{node.spec.where}: {error}") from None
        elif globs:
            topics = matching(globs, available, node.spec.where, must=not self._partial)
        else:
            topics = [t for t in available if find_topic(t).recorded]
        return topics

    def _available(self, node: Wired) -> list[str]:
        own = set(node.outputs.values())
        shares = {topic for topic, (publisher, _) in self._publishers.items() if publisher.part}
        return [*sorted(set(self._publishers) - own - shares), *SYSTEM_TOPICS]

    def _named(self, node: Wired) -> set[str]:
        """What such a reader is told to take by name."""
        return {t for glob in globs_of(node) for t in fnmatch.filter(self._available(node), glob)}

    def _by_default(self, topic: str) -> bool:
        if topic in SYSTEM_TOPICS:
            return True
        publisher = self._publishers[topic][0]
        return not publisher.spec.on_demand or publisher.name in self.demand.inputs


def globs_of(node: Wired) -> list[str]:
    """Lists the globs of topics that a node which takes what it is told was given."""
    return [g if g.startswith(("/", "*")) else f"/{g}" for g in map(str, node.params.get("topics") or [])]


def matching(globs: Iterable[str], available: Iterable[str], where: str, *, must: bool = True) -> list[str]:
    """Lists the topics that match any of the globs. Raises LaunchError for a glob that matches none, if it must."""
    names = list(available)
    found: set[str] = set()
    for glob in globs:
        hits = fnmatch.filter(names, glob)
        if not hits and must:
            raise LaunchError(f"{where}: no topic matches '{glob}'; {nearest(glob, names)}")
        found.update(hits)
    return sorted(found)


def untaken(plan: Plan) -> dict[str, str]:
    """Lists the topics that nodes of a graph would take and that it was started without -> the node."""
    pairs = (item.what.partition(ABSENT) for item in plan.left_out if ABSENT in item.what)
    return {topic: node for node, _, topic in pairs}


def is_open(node: Wired, port: str, demand: Demand) -> bool:
    """Tells whether somebody reads an output of a node, or may come to while the graph runs."""
    return node.late_output(port) or port in demand.wanted.get(node.name, ())


def left_out(nodes: list[Wired], chosen: list[Wired], demand: Demand, absent: Mapping[str, str]) -> list[LeftOut]:
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
        for port, topic in node.inputs.items():
            declared = node.cls.INPUTS[port]
            unpublished = topic not in published and topic not in SYSTEM_TOPICS
            given = declared.outside or (declared.needed and not unpublished)
            if port not in demand.inputs[node.name] and not given:
                found.append(LeftOut(f"{node.name}{ABSENT}{topic}", "nobody publishes it"))
        found += [LeftOut(what, why) for what, why in {**node.cls.imports(node.params), **node.spec.spares}.items()]
    return _merged(found)


def _merged(items: list[LeftOut]) -> list[LeftOut]:
    """Two nodes may leave out the same package; one line is enough."""
    seen: dict[str, LeftOut] = {}
    for item in items:
        seen.setdefault(item.what, item)
    return list(seen.values())
