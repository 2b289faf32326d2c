"""Delivers a published message to the nodes of its own process, by reference, and on its device where they take
it so."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from evis.bus.memory.device import device_of, on_host, without_arrays
from evis.runtime.hosting.host import AnyPublisher, Host
from msgs.header import Message


@dataclass
class Delivery:
    """Holds what the consumers in this process get of one published message.

    given: what each consumer gets, in their order. slots: what the arrays lie in, pinned until `over`.
    """

    given: list[Message]
    slots: list[Any]

    @staticmethod
    def of(
        message: Message,
        publisher: AnyPublisher,
        consumers: Sequence[tuple[Host, str]],
        unread: Collection[str] = (),
        lender: AnyPublisher | None = None,
    ) -> Delivery:
        """Sends a message to other processes and viewers, and makes what the consumers here get.

        Its arrays stay on a device where all who read them take them there; otherwise they are numpy's.
        """
        device = device_of(message)
        if device is None:
            slot = publisher.send(message) or _pin_loan(message, lender)
            return Delivery([message] * len(consumers), [slot])
        there = [consumer.takes(port, device) or f"{consumer.name}:{port}" in unread for consumer, port in consumers]
        slot, host, sent = publisher.claim_on(message), message, None
        in_place = all(there) and publisher.reads_on(device, unread) and publisher.send_on(message, slot)
        if not in_place and (publisher.reads_bytes(unread) or not all(there)):
            host = on_host(message, publisher.loan)
            sent = publisher.send(host)
        elif not in_place and publisher.declared:
            sent = publisher.send(without_arrays(message))
        elif not in_place:
            publisher.passed(message)
        if slot is None:
            slot = _pin_loan(message, lender)
        message._slot = slot  # type: ignore[misc]
        return Delivery([message if takes else host for takes in there], [sent, slot])

    def over(self) -> None:
        """Releases the slots, once every consumer was called; what a consumer keeps it has pinned itself."""
        for slot in self.slots:
            if slot is not None:
                slot.unpin()


def _pin_loan(message: Message, lender: AnyPublisher | None) -> Any:
    """Pins the loan of another topic in which the arrays lie: who keeps this message holds that."""
    slot = None if lender is None else lender.lend(message)
    message._slot = slot  # type: ignore[misc]
    return slot


def read_on_host(publisher: AnyPublisher, consumers: Sequence[tuple[Host, str]], device: Any) -> bool:
    """Tells whether a topic has readers, and all of them read the next message on the host.

    consumers: those in this process, each with its port. device: a Warp device on which they might.
    """
    if any(consumer.takes(port, device) for consumer, port in consumers):
        return False
    return bool(consumers) or (publisher.reads_bytes() and not publisher.reads_on(device))
