"""Hosts a node in its process: the node, its queues, its publishers and subscribers, built from the plan."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import zmq

from evis.bus import LocalPublisher, PeerLost, Publisher, Subscriber, endpoints_for
from evis.console.open_files import with_remedy
from evis.runtime.clock import Pacer, Sampling
from evis.runtime.join import Join
from evis.runtime.node import Node
from evis.runtime.outside.door import Door
from evis.runtime.plan import NodePlan, Plan
from evis.runtime.profile import Profile
from msgs.camera import EventPacket
from msgs.header import Header, Message
from msgs.topics import SYSTEM_TOPICS, find_topic

AnyPublisher = Publisher | LocalPublisher
ALL_READ: frozenset[str] = frozenset()
TAP_HZ = 30.0
EVENT_TAP_HZ = 250.0
"""Taps see images at the rate of a screen; of events, which add up, every packet of a camera that sends some hundred
a second."""


class NodeFailed(Exception):
    """Says that a node raised; carries its name, and the cause as __cause__."""

    def __init__(self, node: str, error: BaseException) -> None:
        super().__init__(f"{node}: {describe(error)}")
        self.node = node


def describe(error: BaseException) -> str:
    """Describes an error in one line for a person."""
    text = with_remedy(str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error))
    if isinstance(error, (ValueError, OSError, KeyError, PeerLost)) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class Inside:
    """Charges the time of a block to one node, and names the node in what the block raises."""

    __slots__ = ("_name", "_profile")

    def __init__(self, profile: Profile | None, name: str) -> None:
        self._name = name
        self._profile = profile

    def __enter__(self) -> Any:
        return self._profile.enter(self._profile.node(self._name)) if self._profile else None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if self._profile:
            self._profile.leave()
        if isinstance(error, Exception) and not isinstance(error, (NodeFailed, PeerLost)):
            raise NodeFailed(self._name, error) from error


def load_class(target: str) -> type[Node]:
    """Imports the class of a dotted target `package.module:Class`."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


@dataclass
class Host:
    """Holds one node and its wiring in this process."""

    node: Node
    plan: NodePlan
    join: Join
    publishers: dict[str, AnyPublisher] = field(default_factory=dict)
    downstream: list[tuple[Host, str, str]] = field(default_factory=list)
    """(consumer, port, topic) of consumers in this process."""
    subscriptions: list[Subscription] = field(default_factory=list)
    arrays: dict[str, list[str]] = field(default_factory=dict)
    """Topics of which the declared readers need only some arrays, as TopicPlan.arrays says."""
    sampled: dict[str, dict[str, tuple[float, Sampling]]] = field(default_factory=dict)
    """Topic -> consumers, as `node:port`, that read only some of its messages' arrays: how often, and which are due."""
    gates: list[AnyPublisher] = field(default_factory=list)
    """Publishers that must have credit before this node is called."""
    lender: AnyPublisher | None = None
    """The one whose loans the messages of its other topics may lie in, within `Node.lending`."""
    singles: set[str] = field(default_factory=set)
    """Topics of declared inputs that are not joined."""
    single_open: set[str] = field(default_factory=set)
    """Those of them that have not ended."""
    waiting: set[str] = field(default_factory=set)
    """Latched topics that the node has not seen yet: no update before them."""
    delayed: dict[str, dict[int, Message]] = field(default_factory=dict)
    service: bool = False
    """Neither a source nor fed by declared inputs (a viewer): lives as long as the graph."""
    many: bool = False
    """It takes several stamps at once, by `update_all`."""
    active: bool = False
    ended: bool = False
    pacer: Pacer | None = None
    door: Door | None = None
    """Where programs outside the graph give what nobody in it does."""
    every: bool = False
    """A dormant node of which somebody wants every message: so it does of what it reads."""
    _missed: int = 0
    """Messages that it has missed since, as far as its readers were told."""
    _devices: dict[str, Any] = field(default_factory=dict)
    """Port -> the Warp device on which the node takes arrays there, None = on the host."""

    @property
    def name(self) -> str:
        """Returns the node's name."""
        return self.plan.name

    def open(self) -> bool:
        """Says whether this node may be called now, without a wait inside it."""
        return not self.gates or all(p.credit() > 0 for p in self.gates)

    def topic_of(self, port: str) -> str | None:
        """Names the topic of an output; None where the planner has left it out. Raises ValueError for no output."""
        topic = self.plan.outputs.get(port)
        if topic is None and port not in self.node.OUTPUTS and not hasattr(self.node, "dynamic_outputs"):
            declared = ", ".join(self.node.OUTPUTS) or "none"
            raise ValueError(f"no output is called '{port}'; {type(self.node).__name__}.OUTPUTS declares {declared}")
        return topic

    def consumers_of(self, topic: str) -> list[tuple[Host, str]]:
        """Lists who takes a topic of this node within the process, with the ports."""
        return [(consumer, port) for consumer, port, consumed in self.downstream if consumed == topic]

    def wants(self, port: str) -> bool:
        """Says whether anybody reads this output now."""
        topic = self.topic_of(port)
        if topic is None:
            return False
        kept = port in self.plan.keep
        return kept or any(t == topic for _, _, t in self.downstream) or self.publishers[topic].wanted()

    def wants_array(self, port: str, array: str) -> bool:
        """Says whether anybody reads this array of an output's messages now. Taps read all."""
        topic = self.topic_of(port)
        if topic is None:
            return False
        if topic not in self.arrays or array in self.arrays[topic]:
            return self.wants(port)
        return self.publishers[topic].tapped()

    def unread_by(self, topic: str, header: Header) -> frozenset[str]:
        """Names the consumers, as `node:port`, that read no arrays of the next message of a topic; once for each."""
        slow = self.sampled.get(topic)
        return frozenset([name for name, (_, due) in slow.items() if not due.takes(header)]) if slow else ALL_READ

    def follow_readers(self) -> None:
        """Asks for every message of what a dormant node reads while somebody wants every one of what it makes."""
        every = any(isinstance(p, Publisher) and p.tapped_by_eager() for p in self.publishers.values())
        if every == self.every:
            return
        self.every, self._missed = every, 0
        for s in self.subscriptions:
            s.subscriber.want_every(every)
            s.lost_before = s.subscriber.lost

    def pass_on_losses(self) -> None:
        """Lets the readers of a dormant node count what its taps have lost: it makes nothing of that."""
        missed = max(s.subscriber.lost - s.lost_before for s in self.subscriptions)
        if missed > self._missed:
            for publisher in self.publishers.values():
                if isinstance(publisher, Publisher) and not publisher.latched:
                    publisher.miss(missed - self._missed)
            self._missed = missed

    def takes(self, port: str, device: Any) -> bool:
        """Says whether the node takes Warp arrays of this device on a port as they are."""
        if port not in self._devices:
            named = self.node.params.get("device") if self.node.INPUTS[port].on_device else None
            if named is not None:
                import warp as wp

                named = wp.get_device(named)
            self._devices[port] = named
        there = self._devices[port]
        return there is not None and bool(there == device)

    def inputs_over(self) -> bool:
        """Says whether nothing more will come that could be given to the node."""
        return (not self.join.queues or self.join.over()) and not self.single_open

    def delayed_inputs(self) -> dict[str, Message] | None:
        """Returns the messages that close a loop back to this source, at the stamps that its next step needs.

        None: they are not there yet.
        """
        inputs: dict[str, Message] = {}
        held = {} if self.door is None else self.door.holdings
        for port, stamp in self.node.due().items():
            if port in held:
                if held[port].waits(stamp):
                    return None
                if (action := held[port].action(stamp)) is not None:
                    inputs[port] = action
                continue
            waiting = self.delayed.get(port)
            if waiting is None:
                continue
            for old in [s for s in waiting if s < stamp]:
                waiting.pop(old).release()
            if stamp not in waiting:
                return None
            inputs[port] = waiting[stamp]
        return inputs

    def rewind(self) -> None:
        """Forgets every message and every end, as before the first message; latched ones were seen."""
        for waiting in self.delayed.values():
            for message in waiting.values():
                message.release()
            waiting.clear()
        self.sampled = {
            topic: {name: (hz, Sampling(hz)) for name, (hz, _) in slow.items()} for topic, slow in self.sampled.items()
        }
        self.join.clear()
        self._devices.clear()  # a node in its place may be on another one
        self.single_open = set(self.singles)
        self.ended, self.pacer = False, None

    def had(self, inputs: Mapping[str, Message]) -> None:
        """Releases the messages that `delayed_inputs` returned, once a step has used them."""
        for port, message in inputs.items():
            if port in self.delayed:
                self.delayed[port].pop(message.header.stamp_ns)
                message.release()
            elif self.door is not None:
                self.door.holdings[port].done()

    def reachable(self) -> list[AnyPublisher]:
        """Lists the publishers of this node and of every node of this process that its messages lead to."""
        seen: dict[str, Host] = {}
        todo = [self]
        while todo:
            host = todo.pop()
            if host.name not in seen:
                seen[host.name] = host
                todo += [consumer for consumer, port, _ in host.downstream if port not in consumer.delayed]
        return [p for host in seen.values() for p in host.publishers.values()]


@dataclass
class Subscription:
    """Connects a topic from another process with a port of a host."""

    subscriber: Subscriber
    host: Host
    port: str
    topic: str
    declared: bool
    ended: bool = False
    """A declared topic is read to its end even when the node needs no more: its publisher waits for that."""
    lost_before: int = 0
    """What a tap had lost as it began to ask for every message."""


class Wiring:
    """Builds the hosts of one process of a plan."""

    def __init__(self, plan: Plan, process: str, context: zmq.Context) -> None:
        self.plan = plan
        self.context = context
        self.hosts: dict[str, Host] = {}
        for node_plan in (n for n in plan.nodes.values() if n.process == process):
            with Inside(None, node_plan.name):
                node = load_class(node_plan.target)(node_plan.name, node_plan.params)
            joined = [p for p, topics in node_plan.inputs.items() if self._is_joined(node, p, topics[0])]
            self.hosts[node_plan.name] = Host(node, node_plan, Join(joined))
        for host in self.hosts.values():
            self._outputs(host)
            self._inputs(host)
            overrides = type(host.node).update_all is not Node.update_all
            host.many = overrides and not plan.single and not host.subscriptions
        for host in self.hosts.values():
            host.gates = [p for p in host.reachable() if p.declared]

    @staticmethod
    def _is_joined(node: Node, port: str, topic: str) -> bool:
        declared = node.INPUTS[port]
        return declared.join and not declared.delayed and declared.topic != "*" and not find_topic(topic).latched

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
                    slow[f"{edge.node}:{edge.port}"] = edge.arrays_hz, Sampling(edge.arrays_hz)
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
                tap_hz=EVENT_TAP_HZ if row.type is EventPacket else TAP_HZ,
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
                    host.singles.add(topic)
                if find_topic(topic).latched:
                    host.waiting.add(topic)
                if kind == "tap" or self.plan.topics[topic].node not in self.hosts:
                    for subscriber in self.subscribe(topic, host.name, port, tap=kind == "tap"):
                        host.subscriptions.append(Subscription(subscriber, host, port, topic, kind != "tap"))
        host.single_open = set(host.singles)
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
        """Names the device on which a node takes arrays of a port as they are; "" = on the host."""
        taker = self.hosts[node].node
        return str(taker.params.get("device") or "") if taker.INPUTS[port].on_device else ""

    def _endpoint_names(self, topic: str) -> list[str]:
        if topic in SYSTEM_TOPICS:
            return [system_topic(topic, p) for p in sorted({n.process for n in self.plan.nodes.values()})]
        return [topic]


def system_topic(topic: str, process: str) -> str:
    """Names the endpoint of one process's share of a system topic."""
    return f"{topic}@{process}"
