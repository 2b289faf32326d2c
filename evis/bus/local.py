"""Publishes a topic that only nodes of this process can read: without sockets or shared memory."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import zmq

from evis.bus.memory.device import DevicePool, DeviceSlot, LoanRequest, check
from evis.bus.memory.lending import Lender
from evis.bus.memory.slots import Slot, SlotPool
from evis.bus.publisher import check_sent
from msgs.codec import checked
from msgs.header import Message

ENOUGH = 1 << 30
"""Credit of a topic whose consumers are called directly."""


class LocalPublisher(Lender):
    """Publishes one topic to nodes of this process, which are called directly, with the interface of Publisher.

    topic, node: names. message_type: the only one that it sends. slots: messages that are kept at the same time, as a
    rule.
    """

    def __init__(self, topic: str, node: str, message_type: type[Message], slots: int = 3) -> None:
        self.topic = topic
        self.node = node
        self.message_type = message_type
        self._pool = SlotPool(topic, slots)
        self._on_device = DevicePool(topic)
        self._seq = self._bytes = 0

    def start(self) -> None:
        """Does nothing: there is nobody to wait for."""

    def pump(self) -> None:
        """Does nothing, for a publisher without sockets receives no messages."""

    def sockets(self) -> Sequence[zmq.Socket | int]:
        """Lists no sockets."""
        return ()

    def missing(self) -> list[str]:
        """Returns no names: the consumers of this process are there."""
        return []

    @property
    def declared(self) -> bool:
        """Returns False: `send` never waits for a consumer."""
        return False

    def credit(self) -> int:
        """Returns a number of messages without limit."""
        return ENOUGH

    def wanted(self) -> bool:
        """Returns False: nothing outside the process reads it."""
        return False

    def tapped(self) -> bool:
        """Returns False: no tap can listen."""
        return False

    def reads_bytes(self, but: Collection[str] = ()) -> bool:
        """Returns False: nothing needs numpy arrays for their bytes' sake."""
        return False

    def loan_on(self, device: Any, asked: LoanRequest) -> dict[str, Any]:
        """Returns Warp arrays on a device as `loan` does: name -> (shape, Warp dtype)."""
        if device.is_cuda:
            self._pool.write_from(device)
        return self._on_device.loan(device, asked)

    def reads_on(self, device: Any, but: Collection[str] = ()) -> bool:
        """Returns False: no other process reads it."""
        return False

    def send_on(self, message: Message, slot: DeviceSlot | None) -> bool:
        """Does nothing: no other process reads it."""
        return False

    def passed(self, message: Message) -> None:
        """Counts a message whose arrays stay on their device."""
        check_sent(self.topic, self.node, self.message_type, message)
        self._count(message, check(message))

    def send(self, message: Message) -> Slot | None:
        """Fills header.seq, and returns the slot that the arrays lie in, pinned once for the caller, or None.

        Raises BusError for a message of another type, or one that was published before; MessageError for a wrong one.
        """
        check_sent(self.topic, self.node, self.message_type, message)
        arrays = checked(message)
        slot = self._pool.claim(arrays)
        self._count(message, sum([a.nbytes for a in arrays.values()]))
        message._slot = slot  # type: ignore[misc]
        return slot

    def _count(self, message: Message, size: int) -> None:
        message.header.seq = self._seq
        self._seq += 1
        self._bytes += size

    def finish(self, timeout_s: float | None = None) -> bool:
        """Returns True: the stream has ended everywhere."""
        return True

    def close(self) -> None:
        """Releases the memory."""
        self._pool.close()

    def stats(self) -> dict[str, float]:
        """Returns counters since the start: messages, bytes, time waited for credit, slots."""
        return {"sent": self._seq, "bytes": self._bytes, "waits_s": 0.0, "slots": self._pool.live}
