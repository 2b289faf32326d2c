"""Publishes for the nodes of one process: tells what is read, lends memory to write into, and delivers.

Nodes of the process are called directly with the message (scheduler.py); it goes over the bus to those of others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from evis.bus.publisher import check_sent
from evis.runtime.delivery import Delivery, read_on_host
from evis.runtime.hosting.host import Host
from evis.runtime.node import Node
from evis.runtime.plan import Plan
from evis.runtime.profile import Profile
from evis.runtime.scheduler import Scheduler
from msgs.header import Message


class Outputs:
    """Publishes for the nodes of one process: the part of node.Runtime that is about outputs."""

    def __init__(self, plan: Plan, hosts: dict[str, Host], profile: Profile, scheduler: Scheduler) -> None:
        self.plan = plan
        self.profile = profile
        self._hosts = hosts
        self._scheduler = scheduler
        self._latched: dict[str, Message] = {}
        """What was published last on each latched topic, for a node that is made anew."""

    def wants(self, node: Node, port: str, array: str = "") -> bool:
        """Implements Node.wants."""
        host = self._hosts[node.name]
        return host.wants_array(port, array) if array else host.wants(port)

    def gathered(self, node: Node, port: str) -> int:
        """Implements Node.gathered."""
        host = self._hosts[node.name]
        topic = host.plan.outputs.get(port)
        if topic is None:
            return 1
        return max(
            (consumer.node.gathers for consumer, _ in host.consumers_of(topic) if consumer.takes_several), default=1
        )

    def loan(self, node: Node, port: str, arrays: Mapping[str, tuple[tuple[int, ...], Any]]) -> dict[str, np.ndarray]:
        """Implements Node.loan."""
        host = self._hosts[node.name]
        return host.publishers[host.plan.outputs[port]].loan(**arrays)

    def loan_on(self, node: Node, port: str, device: Any, arrays: Mapping[str, tuple[tuple[int, ...], Any]]) -> Any:
        """Implements Node.loan_on."""
        host = self._hosts[node.name]
        return host.publishers[host.plan.outputs[port]].loan_on(device, arrays)

    def loan_for_readers(
        self, node: Node, port: str, device: Any, arrays: Mapping[str, tuple[tuple[int, ...], Any]]
    ) -> Any:
        """Implements Node.loan_for_readers."""
        host = self._hosts[node.name]
        topic = host.plan.outputs[port]
        publisher = host.publishers[topic]
        consumers = host.consumers_of(topic)
        if read_on_host(publisher, consumers, device):
            return publisher.loan_from(device, arrays)
        return publisher.loan_on(device, arrays)

    @contextmanager
    def lending(self, node: Node, port: str) -> Iterator[None]:
        """Implements Node.lending."""
        host = self._hosts[node.name]
        lender = host.publishers[host.plan.outputs[port]]
        with lender.sharing_loans():
            host.lender = lender
            try:
                yield
            finally:
                host.lender = None

    def publish(self, node: Node, port: str, message: Message) -> None:
        """Implements Node.publish."""
        host = self._hosts[node.name]
        topic = host.topic_of(port)
        if topic is None:
            return
        check_sent(topic, node.name, host.publishers[topic].message_type, message)
        self.profile.node(node.name).saw(topic, message)
        if self.plan.topics[topic].latched:
            self._latched[topic] = message
        with self.profile.inside("bus"):
            consumers = host.consumers_of(topic)
            unread = host.unread_by(topic, message.header)
            delivery = Delivery.of(message, host.publishers[topic], consumers, unread, host.lender)
        try:
            for (consumer, consumer_port), given in zip(consumers, delivery.given):
                given.keep()
                self._scheduler.accept(consumer, consumer_port, topic, given)
                if not consumer.node.SOURCE and not consumer.takes_several:
                    self._scheduler.call(consumer)
            # What one of these makes of many stamps, another one takes with this message beside it.
            for consumer, _ in consumers:
                if consumer.takes_several:
                    self._scheduler.call(consumer)
        finally:
            delivery.over()

    def publish_all(self, node: Node, port: str, messages: Sequence[Message]) -> None:
        """Implements Node.publish_all."""
        host = self._hosts[node.name]
        topic = host.topic_of(port)
        if topic is None:
            return
        publisher, profile = host.publishers[topic], self.profile.node(node.name)
        consumers = host.consumers_of(topic)
        with publisher.sharing_loans(), self.profile.inside("bus"):
            for message in messages:
                check_sent(topic, node.name, publisher.message_type, message)
                profile.saw(topic, message)
                unread = host.unread_by(topic, message.header)
                delivery = Delivery.of(message, publisher, consumers, unread, host.lender)
                try:
                    for (consumer, consumer_port), given in zip(consumers, delivery.given):
                        given.keep()
                        self._scheduler.accept(consumer, consumer_port, topic, given)
                finally:
                    delivery.over()
        for consumer, _ in consumers:
            if not consumer.node.SOURCE:
                self._scheduler.call(consumer)
