"""Makes the nodes of one process of a plan, and connects their ports to each other or to other processes."""

from __future__ import annotations

import importlib

import zmq

from evis.bus import LocalPublisher, Publisher, Subscriber, endpoints_for
from evis.runtime.hosting.host import Host, Subscription
from evis.runtime.hosting.join import Join
from evis.runtime.hosting.node_call import NodeCall
from evis.runtime.node import Node
from evis.runtime.pacing import RateLimit
from evis.runtime.plan import Plan
from msgs.camera import EventPacket
from msgs.topics import SYSTEM_TOPICS, find_topic

TAP_HZ = 30.0
EVENT_TAP_HZ = 250.0
"""Taps see images at the rate of a screen; of events, which add up, every packet of a camera that sends some hundred
a second."""


def tap_hz(topic: str) -> float:
    """Returns how many messages a second a tap gets of a topic that a node publishes, unless it wants every one; of
    images, of each environment."""
    return EVENT_TAP_HZ if find_topic(topic).type is EventPacket else TAP_HZ


def load_class(target: str) -> type[Node]:
    """Imports the class of a dotted target `package.module:Class`."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


class Wiring:
    """Makes the hosts of one process of a plan, with their publishers and subscribers."""

    def __init__(self, plan: Plan, process: str, context: zmq.Context) -> None:
        self.plan = plan
        self.context = context
        self.hosts: dict[str, Host] = {}
        for node_plan in (n for n in plan.nodes.values() if n.process == process):
            with NodeCall(None, node_plan.name):
                node = load_class(node_plan.target)(node_plan.name, node_plan.params)
                node.told_by, node.tells_for = node_plan.told_by, node_plan.tells_for
            joined = [p for p, topics in node_plan.inputs.items() if node.INPUTS[p].joins(topics[0])]
            self.hosts[node_plan.name] = Host(node, node_plan, Join(joined))
        for host in self.hosts.values():
            self._outputs(host)
            self._inputs(host)
            overrides = type(host.node).update_all is not Node.update_all
            host.takes_several = overrides and not plan.single and not host.subscriptions
        for host in self.hosts.values():
            host.needs_credit_of = [p for p in host.reachable_publishers() if p.declared]

    def _outputs(self, host: Host) -> None:
        for topic in host.plan.outputs.values():
            if (arrays := self.plan.topics[topic].arrays) is not None:
                host.arrays[topic] = arrays
            remote = []
            for edge in self.plan.topics[topic].edges:
                if edge.kind == "tap":
                    continue
                if edge.arrays_hz is not None:
                    slow = host.sampled.setdefault(topic, {})
                    slow[f"{edge.node}:{edge.port}"] = edge.arrays_hz, RateLimit(edge.arrays_hz)
                if edge.node in self.hosts:
                    host.downstream.append((self.hosts[edge.node], edge.port, topic))
                else:
                    remote.append(f"{edge.node}:{edge.port}")
            row = find_topic(topic)
            if self.plan.closed:
                host.publishers[topic] = LocalPublisher(topic, host.name, row.type, self.plan.window + 1)
                continue
            host.publishers[topic] = Publisher(
                self.context,
                topic,
                host.name,
                endpoints_for(self.plan.directory, topic),
                remote,
                message_type=row.type,
                window=self.plan.window,
                latched=row.latched,
                tap_hz=tap_hz(topic),
            )

    def _inputs(self, host: Host) -> None:
        kinds = set()
        for port, topics in host.plan.inputs.items():
            if host.node.INPUTS[port].delayed:
                host.delayed[port] = {}
            for topic in topics:
                kind = self._edge_kind(topic, host.name, port)
                kinds.add(kind)
                if port not in host.join.queues and kind == "lockstep":
                    host.unjoined_topics.add(topic)
                if find_topic(topic).latched:
                    host.unseen_latched.add(topic)
                if kind == "tap" or self.plan.topics[topic].node not in self.hosts:
                    for subscriber in self.subscribe(topic, host.name, port, tap=kind == "tap"):
                        host.subscriptions.append(Subscription(subscriber, host, port, topic, kind != "tap"))
        host.open_unjoined = set(host.unjoined_topics)
        host.service = not host.node.SOURCE and kinds <= {"tap"}

    def _edge_kind(self, topic: str, node: str, port: str) -> str:
        if topic in SYSTEM_TOPICS:
            return "tap"
        for edge in self.plan.topics[topic].edges:
            if (edge.node, edge.port) == (node, port):
                return edge.kind
        raise ValueError(f"{node}: input {port} reads {topic}, but the plan has no such edge")

    def subscribe(self, topic: str, node: str, port: str, *, tap: bool) -> list[Subscriber]:
        """Makes the subscribers of a topic, not started: one, or one per process for a system topic.

        Raises ValueError in a graph without sockets.
        """
        if self.plan.closed:
            raise ValueError(f"{node}: {topic} cannot be tapped, the graph has no sockets")
        row = find_topic(topic)
        return [
            Subscriber(
                self.context,
                topic,
                node,
                port,
                endpoints_for(self.plan.directory, name),
                message_type=row.type,
                tap=tap,
                window=self.plan.window,
                device="" if tap else self._device_of(node, port),
            )
            for name in self._endpoint_names(topic)
        ]

    def _device_of(self, node: str, port: str) -> str:
        """Returns the device on which a node takes arrays of a port as they are; "" = on the host."""
        taker = self.hosts[node].node
        return str(taker.params.get("device") or "") if taker.INPUTS[port].on_device else ""

    def _endpoint_names(self, topic: str) -> list[str]:
        if topic in SYSTEM_TOPICS:
            return [system_topic(topic, p) for p in sorted({n.process for n in self.plan.nodes.values()})]
        return [topic]


def system_topic(topic: str, process: str) -> str:
    """Returns the endpoint of one process's part of a system topic."""
    return f"{topic}@{process}"
