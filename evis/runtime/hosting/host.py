"""Hosts a node in its process: with its queues, publishers and subscribers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from evis.bus import LocalPublisher, Publisher, Subscriber
from evis.runtime.hosting.join import Join
from evis.runtime.node import Node
from evis.runtime.outside.inputs import OutsideInputs
from evis.runtime.pacing import Pacer, RateLimit
from evis.runtime.plan import NodePlan
from msgs.header import Header, Message

AnyPublisher = Publisher | LocalPublisher
ALL_READ: frozenset[str] = frozenset()


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
    sampled: dict[str, dict[str, tuple[float, RateLimit]]] = field(default_factory=dict)
    """Topic -> consumers, as `node:port`, that read only some of its messages' arrays: how often, and which are due."""
    needs_credit_of: list[AnyPublisher] = field(default_factory=list)
    """Publishers that must have credit before this node is called."""
    lender: AnyPublisher | None = None
    """The one whose loans the messages of its other topics may lie in, within `Node.lending`."""
    unjoined_topics: set[str] = field(default_factory=set)
    """Topics of declared inputs that are not joined."""
    open_unjoined: set[str] = field(default_factory=set)
    """Those of them that have not ended."""
    unseen_latched: set[str] = field(default_factory=set)
    """Latched topics that the node has not seen yet: no update before them."""
    delayed: dict[str, dict[int, Message]] = field(default_factory=dict)
    service: bool = False
    """Neither a source nor fed by declared inputs (a viewer): lives as long as the graph."""
    takes_several: bool = False
    """It takes several stamps at once, by `update_all`."""
    active: bool = False
    ended: bool = False
    spent: bool = False
    """A source that has given all that it has."""
    pacer: Pacer | None = None
    outside: OutsideInputs | None = None
    """Where programs outside the graph give what nobody in it does."""
    wants_every: bool = False
    """A dormant node of which somebody wants every message: so it does of what it reads."""
    _missed: int = 0
    """Messages that it has missed since, as far as its readers were told."""
    _devices: dict[str, Any] = field(default_factory=dict)
    """Port -> the Warp device on which the node takes arrays there, None = on the host."""

    @property
    def name(self) -> str:
        """Returns the node's name."""
        return self.plan.name

    def has_credit(self) -> bool:
        """Tells whether this node may be called now without a wait inside it."""
        return not self.needs_credit_of or all(p.credit() > 0 for p in self.needs_credit_of)

    def topic_of(self, port: str) -> str | None:
        """Returns the topic of an output; None where the planner has left it out. Raises ValueError for no output."""
        topic = self.plan.outputs.get(port)
        if topic is None and port not in self.node.OUTPUTS and not hasattr(self.node, "dynamic_outputs"):
            declared = ", ".join(self.node.OUTPUTS) or "none"
            raise ValueError(f"no output is called '{port}'; {type(self.node).__name__}.OUTPUTS declares {declared}")
        return topic

    def consumers_of(self, topic: str) -> list[tuple[Host, str]]:
        """Lists the consumers of one of this node's topics within the process, with their ports."""
        return [(consumer, port) for consumer, port, consumed in self.downstream if consumed == topic]

    def wants(self, port: str) -> bool:
        """Tells whether something reads this output now."""
        topic = self.topic_of(port)
        if topic is None:
            return False
        kept = port in self.plan.keep
        return kept or any(t == topic for _, _, t in self.downstream) or self.publishers[topic].wanted()

    def wants_array(self, port: str, array: str) -> bool:
        """Tells whether something reads this array of an output's messages now. Taps read all."""
        topic = self.topic_of(port)
        if topic is None:
            return False
        if topic not in self.arrays or array in self.arrays[topic]:
            return self.wants(port)
        return self.publishers[topic].tapped()

    def unread_by(self, topic: str, header: Header) -> frozenset[str]:
        """Lists the consumers `node:port` that read no arrays of a topic's next message; to be asked once for each."""
        slow = self.sampled.get(topic)
        return frozenset([name for name, (_, due) in slow.items() if not due.takes(header)]) if slow else ALL_READ

    def follow_readers(self) -> None:
        """Subscribes a dormant node's inputs to every message while a reader wants every message of its outputs."""
        every = any(isinstance(p, Publisher) and p.tapped_by_eager() for p in self.publishers.values())
        if every == self.wants_every:
            return
        self.wants_every, self._missed = every, 0
        for s in self.subscriptions:
            s.subscriber.want_every(every)
            s.lost_before = s.subscriber.lost

    def pass_on_losses(self) -> None:
        """Passes on to the readers of a dormant node, as missing sequence numbers, what its taps have lost."""
        missed = max(s.subscriber.lost - s.lost_before for s in self.subscriptions)
        if missed > self._missed:
            for publisher in self.publishers.values():
                if isinstance(publisher, Publisher) and not publisher.latched:
                    publisher.miss(missed - self._missed)
            self._missed = missed

    def takes(self, port: str, device: Any) -> bool:
        """Tells whether a port of the node takes Warp arrays of this device as they are."""
        if port not in self._devices:
            named = self.node.params.get("device") if self.node.INPUTS[port].on_device else None
            if named is not None:
                import warp as wp

                named = wp.get_device(named)
            self._devices[port] = named
        there = self._devices[port]
        return there is not None and bool(there == device)

    def inputs_over(self) -> bool:
        """Tells whether nothing more will come for the node."""
        return (not self.join.queues or self.join.over()) and not self.open_unjoined

    def delayed_inputs(self) -> dict[str, Message] | None:
        """Returns the messages that close a loop back to this source, at the stamps that its next step needs.

        None where they are not there yet.
        """
        inputs: dict[str, Message] = {}
        held = {} if self.outside is None else self.outside.controlled
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
        """Removes all messages and ends, as before the first message; latched messages count as seen."""
        for waiting in self.delayed.values():
            for message in waiting.values():
                message.release()
            waiting.clear()
        self.sampled = {
            topic: {name: (hz, RateLimit(hz)) for name, (hz, _) in slow.items()} for topic, slow in self.sampled.items()
        }
        self.join.clear()
        self._devices.clear()  # a node in its place may be on another one
        self.open_unjoined = set(self.unjoined_topics)
        self.ended, self.spent, self.pacer = False, False, None

    def release_delayed(self, inputs: Mapping[str, Message]) -> None:
        """Releases the messages that `delayed_inputs` returned, after the step that used them."""
        for port, message in inputs.items():
            if port in self.delayed:
                self.delayed[port].pop(message.header.stamp_ns)
                message.release()
            elif self.outside is not None:
                self.outside.controlled[port].done()

    def reachable_publishers(self) -> list[AnyPublisher]:
        """Lists the publishers of this node and of every node of the process that its messages reach."""
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
