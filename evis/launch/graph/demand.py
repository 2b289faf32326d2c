"""Finds what a graph needs, from its sinks back to its sources, and leaves out the rest."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from evis.config.document import LaunchError
from evis.config.suggestions import nearest
from evis.launch.arguments import ArgumentError
from evis.launch.graph.wiring import WiredNode
from msgs.topics import SYSTEM_TOPICS, find_topic


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
        self, nodes: list[WiredNode], publishers: Mapping[str, tuple[WiredNode, str]], *, partial: bool = False
    ) -> None:
        self._nodes = nodes
        self._partial = partial
        self._publishers = publishers
        self._missing = {topic: why for node in nodes for topic, why in node.missing.items()}
        self.demand = Demand()

    def run(self) -> Demand:
        """Follows sinks and kept outputs first, then those that take what they are told, by name and at last by
        default.
        """
        for node in (n for n in self._nodes if n.spec.tap):
            node.needs(())  # nobody wants anything of a viewer, whose parameters have to go together all the same
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

    def attached(self, node: WiredNode) -> Demand:
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

    def _unpublished(self, node: WiredNode, topic: str) -> LaunchError:
        if topic in self._missing:
            return ArgumentError(f"{node.spec.where}: '{node.name}' reads {topic}, but {self._missing[topic]}")
        remedies = {source.cls.REMEDY.format(topic=topic) for source in self._nodes if source.cls.REMEDY}
        remedy = "; ".join(sorted(remedies)) or nearest(topic, self._publishers)
        return LaunchError(f"{node.spec.where}: '{node.name}' reads {topic}, which nobody publishes; {remedy}")

    def _need(self, node: WiredNode, ports: set[str]) -> None:
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

    def _read(self, node: WiredNode) -> None:
        """Connects a node that takes any topics, as a recorder does, to those chosen for it."""
        topics = self._chosen(node)
        self._need(node, set())
        self.demand.inputs[node.name][node.any_port or ""] = topics
        for topic in topics:
            self._want(topic)

    def _chosen(self, node: WiredNode) -> list[str]:
        """Lists the topics that a node which takes any reads: by its class, by the globs of `topics`, or all recorded
        ones.

        What is made on demand is read by default only where somebody has demanded it already.
        """
        globs, named = globs_of(node), self._named(node)
        for glob in globs:
            # Of a topic that is named and that there cannot be it is said why; `*` is content with the others.
            if not fnmatch.filter(self._available(node), glob) and (hits := fnmatch.filter(self._missing, glob)):
                raise self._unpublished(node, hits[0])
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

    def _available(self, node: WiredNode) -> list[str]:
        own = set(node.outputs.values())
        shares = {topic for topic, (publisher, _) in self._publishers.items() if publisher.part}
        return [*sorted(set(self._publishers) - own - shares), *SYSTEM_TOPICS]

    def _named(self, node: WiredNode) -> set[str]:
        """Lists the topics that a node which takes any is told to take by name."""
        return {t for glob in globs_of(node) for t in fnmatch.filter(self._available(node), glob)}

    def _by_default(self, topic: str) -> bool:
        if topic in SYSTEM_TOPICS:
            return True
        publisher = self._publishers[topic][0]
        return not publisher.spec.on_demand or publisher.name in self.demand.inputs


def globs_of(node: WiredNode) -> list[str]:
    """Lists the globs under `topics` of a node that takes any topics."""
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


def is_open(node: WiredNode, port: str, demand: Demand) -> bool:
    """Tells whether somebody reads an output of a node, or may come to while the graph runs."""
    return node.late_output(port) or port in demand.wanted.get(node.name, ())
