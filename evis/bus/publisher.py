"""Implements the sending end of a topic."""

from __future__ import annotations

import time
from collections.abc import Collection
from typing import Any

import numpy as np
import zmq

from evis.bus import pipes, wire
from evis.bus.consumers import Consumer, Consumers
from evis.bus.endpoints import Endpoints, bind, check_bind, unlink
from evis.bus.errors import BusError, PeerLost
from evis.bus.memory.device import DevicePool, DeviceSlot, LoanRequest, check
from evis.bus.memory.lending import Lender
from evis.bus.memory.placing import describe, place
from evis.bus.memory.slots import Pinned, Slot, SlotPool
from evis.bus.tap import TapSender, queue_length
from msgs.codec import Buffer, checked, contiguous, pack_header, raw
from msgs.header import Message

INLINE_BELOW = 1 << 15
"""Messages with fewer bytes of arrays travel inside the socket: below this shared memory saves nothing."""
LATCHED_QUEUE = 64
"""Values of a latched topic that a tap may lag behind: the last one must arrive, and there are few."""
POLL_MS = 100
PUMP_EVERY_S = 0.005
"""A stream looks at its sockets this often; while credits come through the pipe nothing there is urgent."""


class Publisher(Lender):
    """Publishes one topic: to its declared consumers without loss, to taps as far as they follow.

    context: of ZeroMQ, the process's. topic, node: names. endpoints: the addresses that it binds. consumers: ids
    `node:port` of the declared consumers in other processes. message_type: the only one that it sends. window: messages
    that each consumer may be behind. latched: a consumer that connects late gets the last value. tap_hz: most messages
    per second on the tap [Hz], of each environment that has its own, 0 = all. All calls are from one thread.
    Raises BusError, and PeerLost when a consumer is gone.
    """

    def __init__(
        self,
        context: zmq.Context,
        topic: str,
        node: str,
        endpoints: Endpoints,
        consumers: list[str],
        *,
        message_type: type[Message],
        window: int = 2,
        latched: bool = False,
        tap_hz: float = 30.0,
    ) -> None:
        if window < 1:
            raise BusError(f"topic {topic}: the window is {window}, at least 1 message must be under way")
        self.topic = topic
        self.node = node
        self.endpoints = endpoints
        self.message_type = message_type
        self.latched = latched
        self._context = context
        self._frame = topic.encode()
        # A latched message also reaches consumers that are half connected, which only the socket does.
        self._consumers = Consumers(topic, node, consumers, message_type, window, piped=not latched)
        # The last value of a latched topic must arrive, however soon it follows another.
        self._tap = TapSender(topic, 0.0 if latched else tap_hz)
        self._pool = SlotPool(topic, window + 1, shared=bool(consumers))
        self._on_device = DevicePool(topic)
        self._latch: list[Buffer] | None = None
        self._sockets: list[zmq.Socket] = []
        self._seq = 0
        self._bytes = self._copies = 0
        self._waited_s = 0.0
        self._pump_at = 0.0

    def start(self) -> None:
        """Binds the sockets. Raises BusError: address in use, directory not private."""
        for address in self.endpoints:
            check_bind(address)
        data = self._open(zmq.XPUB)
        router = self._open(zmq.ROUTER)
        tap = self._open(zmq.XPUB, LATCHED_QUEUE if self.latched else queue_length(self.topic))
        self._data = data
        self._consumers.attach(router)
        self._poller = wire.poller(self._consumers.inbox.fileno(), data, router, tap)
        self._handlers = {
            data: self._consumers.handle_xpub, router: self._consumers.handle_router, tap: self._tap.handle_xpub,
        }  # fmt: skip
        bind(data, self.endpoints.lockstep)
        bind(router, self.endpoints.credit)
        self._tap.open(tap, self.endpoints.tap)

    def _open(self, kind: int, high_water_mark: int = 0) -> zmq.Socket:
        sock = wire.open_socket(self._context, kind, high_water_mark)
        sock.setsockopt(zmq.MAXMSGSIZE, wire.MAX_TALK)
        self._sockets.append(sock)
        return sock

    def sockets(self) -> list[zmq.Socket | int]:
        """Lists sockets and a file descriptor for a poller: call `pump` when one is readable."""
        return [self._consumers.inbox.fileno(), *self._sockets]

    def pump(self) -> None:
        """Handles credits, newcomers and departures; never waits. Raises PeerLost."""
        self._consumers.collect()
        for sock in self._sockets:
            self._handle(sock)
        self._settle()

    def _handle(self, sock: zmq.Socket) -> None:
        while wire.readable(sock):
            self._handlers[sock](sock.recv_multipart())

    def _wait_for_consumers(self, timeout_ms: int) -> None:
        """Waits until something comes, and handles it; a credit that comes soon saves a look at the sockets."""
        if self._consumers.wait_for_credits(timeout_ms):
            return
        for ready, _ in self._poller.poll(timeout_ms):
            if ready in self._handlers:
                self._handle(ready)
            else:
                self._consumers.collect()
        self._settle()

    def _settle(self) -> None:
        self._consumers.raise_lost()
        for consumer in self._consumers.arrivals():
            self._pool.share(self._consumers.shared())
            if self._latch is not None:
                wire.send(self._data, [consumer.key, *self._latch])
                self._consumers.charge([consumer], self._seq - 1, None)

    def missing(self) -> list[str]:
        """Lists the declared consumers that are not connected."""
        self.pump()
        return self._consumers.missing()

    @property
    def declared(self) -> bool:
        """Tells whether consumers are declared: those for which `send` may have to wait."""
        return bool(self._consumers.all)

    def credit(self) -> int:
        """Returns how many messages `send` takes without waiting."""
        return self._consumers.credit()

    def wanted(self) -> bool:
        """Tells whether a declared consumer, or a tap right now, reads this topic."""
        return bool(self._consumers.all) or self._tap.listeners > 0

    def tapped(self) -> bool:
        """Tells whether a tap listens."""
        return self._tap.listeners > 0

    def tapped_by_eager(self) -> bool:
        """Tells whether a tap listens that wants every message."""
        return self._tap.eager > 0

    def miss(self, count: int) -> None:
        """Skips sequence numbers, which readers count as lost: messages that its node could not make. Not for a latched
        topic."""
        self._seq += count

    def loan(self, **arrays: tuple[tuple[int, ...], Any]) -> dict[str, np.ndarray]:
        """Returns aligned arrays to write the next message into, name -> (shape, dtype); valid until `send`."""
        if not self._pool.ready():
            self._consumers.collect()  # a slot may be free by now
        return self._pool.loan(arrays)

    def loan_on(self, device: Any, asked: LoanRequest) -> dict[str, Any]:
        """Returns Warp arrays on a device as `loan` does: name -> (shape, Warp dtype)."""
        if device.is_cuda:
            self._pool.write_from(device)
        exported = device.is_cuda and any(c.gpu == device.uuid for c in self._consumers.all.values())
        return self._on_device.loan(device, asked, exported)

    def reads_bytes(self, but: Collection[str] = ()) -> bool:
        """Tells whether the next message must be sent in numpy arrays: another process or a viewer reads it.

        but: consumers, as `node:port`, that read no arrays of it.
        """
        return self.latched or not self._consumers.all.keys() <= set(but) or self._tap.ready()

    def reads_on(self, device: Any, but: Collection[str] = ()) -> bool:
        """Tells whether other processes read the next message, and all of them on this Warp device.

        but: consumers, as `node:port`, that read no arrays of it.
        """
        if not device.is_cuda or self.latched or self._tap.ready():
            return False
        readers = [consumer for consumer in self._consumers.all.values() if consumer.name not in but]
        return bool(readers) and all(consumer.gpu == device.uuid for consumer in readers)

    def passed(self, message: Message) -> None:
        """Counts a message whose arrays stay on their device, because no other process gets it."""
        check_sent(self.topic, self.node, self.message_type, message)
        message.header.seq = self._seq
        self._bytes += check(message)
        self._seq += 1
        self._tap.skipped += bool(self._tap.listeners)

    def send_on(self, message: Message, slot: DeviceSlot | None) -> bool:
        """Publishes, as `send` does, a message whose arrays readers take on their device (`reads_on`); slot: of
        `claim_on`.

        False, and nothing is sent, where they are not all in a slot that other processes can read.
        """
        placed = None if slot is None else slot.placed(message)
        if slot is None or slot.exported is None or placed is None:
            return False
        check_sent(self.topic, self.node, self.message_type, message)
        self._wait_for_credit(None)
        message.header.seq = self._seq
        slot.exported.written()
        self._deliver(self._receivers(), [placed.packed(message, slot.exported)], slot)
        self._tap.skipped += bool(self._tap.listeners)
        self._seq += 1
        self._bytes += sum(form.nbytes for form in placed.forms.values())
        return True

    def send(self, message: Message, timeout_s: float | None = None) -> Slot | None:
        """Publishes a message, and fills header.seq.

        Waits while a declared consumer has no credit, at most timeout_s (BusError then).

        Arrays that lie in the loan are not copied. Returns the slot that the arrays lie in, pinned once for the caller
        (`unpin` it when local delivery is over), or None when they lie in no slot. A latched message does not wait for
        consumers that are not connected yet: they get the last value when they come.
        """
        check_sent(self.topic, self.node, self.message_type, message)
        arrays = checked(message)
        self._wait_for_credit(timeout_s)
        message.header.seq = self._seq
        size = sum([a.nbytes for a in arrays.values()])
        slot = self._pool.claim(arrays)
        consumers, tapped = self._receivers(), self._tap.due(*message.environment)
        # A latched message reaches half-connected consumers too, which hold no slot: it carries its arrays.
        by_slot = bool(consumers) and self._pool.shared and size >= INLINE_BELOW and not self.latched
        # What is copied into a slot as a whole is in order there.
        if slot is not None or (not by_slot and (consumers or tapped or self.latched)):
            arrays = {name: contiguous(array) for name, array in arrays.items()}
        try:
            if by_slot:
                slot, offsets, copies = place(self._pool, message, arrays, slot)
                self._copies += copies
                self._deliver(consumers, describe(message, arrays, slot, offsets), slot)
            if tapped or self.latched or (consumers and not by_slot):
                inline = [pack_header(message, arrays), *map(raw, arrays.values())]
                if not by_slot:
                    self._deliver(consumers, inline, None)
                if tapped:
                    self._tap.send(inline)
                if self.latched:
                    self._latch = self._tap.latched = [bytes(part) for part in inline]
        except BaseException:
            if slot is not None:
                slot.unpin()
            raise
        message._slot = slot  # type: ignore[misc]
        self._seq += 1
        self._bytes += size
        return slot

    def _deliver(self, consumers: list[Consumer], frames: list[Buffer], slot: Pinned | None) -> None:
        if consumers:
            self._broadcast(frames)
            self._consumers.charge(consumers, self._seq, slot)

    def _broadcast(self, frames: list[Buffer]) -> None:
        """Sends through the pipes where every consumer's has room for the record, else over the socket, in the same
        order."""
        through_pipes = pipes.packed_size(frames) <= self._consumers.room()
        record = pipes.pack(frames) if through_pipes else pipes.ELSEWHERE
        for consumer in self._consumers.all.values():
            if consumer.outlet is not None and not consumer.outlet.write(record):
                raise PeerLost(consumer.name, self.topic, "has a full pipe, which its credits rule out")
        if not through_pipes:
            wire.send(self._data, [self._frame, *frames])

    def _receivers(self) -> list[Consumer]:
        return [c for c in self._consumers.all.values() if c.greeted]

    def _blocked(self) -> bool:
        if self.latched:
            return any(len(c.uncredited) >= c.window for c in self._receivers())
        return self._consumers.credit() <= 0

    def _wait_for_credit(self, timeout_s: float | None) -> None:
        start = time.monotonic()
        if start >= self._pump_at:
            self._pump_at = start + PUMP_EVERY_S
            self.pump()
        if not self._blocked():
            return
        try:
            self._consumers.collect()
            while self._blocked():
                left_s = 1.0 if timeout_s is None else start + timeout_s - time.monotonic()
                if left_s <= 0:
                    slow = ", ".join(self._consumers.behind())
                    raise BusError(f"topic {self.topic}: no credit from {slow} for {timeout_s} s")
                self._wait_for_consumers(min(POLL_MS, int(1000 * left_s) + 1))
        finally:
            self._waited_s += time.monotonic() - start

    def finish(self, timeout_s: float | None = None) -> bool:
        """Ends the stream: announces the end (once), and waits until every consumer has answered.

        False when some have not answered within timeout_s (0: just look); call again. Raises PeerLost for one that died
        meanwhile.
        """
        heard_at = time.monotonic()
        self.pump()
        if not self._consumers.finishing:
            self._consumers.finishing = True
            end: list[Buffer] = [wire.END_HEADER, self._seq.to_bytes(8, "little")]
            self._tap.end(end)
            self._broadcast(end)
        deadline = time.monotonic() + (1e9 if timeout_s is None else timeout_s)
        while self._consumers.unfinished(heard_at):
            left_s = deadline - time.monotonic()
            if left_s <= 0:
                return False
            self._wait_for_consumers(min(POLL_MS, int(1000 * left_s) + 1))
            heard_at = time.monotonic()
            self.pump()
        return True

    def close(self) -> None:
        """Releases sockets and memory. Without `finish` before it, messages under way are lost."""
        for sock in self._sockets:
            sock.close(linger=1000 if sock is getattr(self._tap, "socket", None) else 0)
        if self._sockets:
            unlink(self.endpoints)
        self._sockets = []
        self._consumers.close()
        self._pool.close()

    def stats(self) -> dict[str, float]:
        """Returns counters since the start: messages, bytes, copies, time waited for credit, taps, slots, refusals."""
        return {
            "sent": self._seq,
            "bytes": self._bytes,
            "copies": self._copies,
            "waits_s": self._waited_s,
            "tap_sent": self._tap.sent,
            "tap_skipped": self._tap.skipped,
            "slots": self._pool.live,
            "spare_slots": self._pool.spares,
            "rejected": self._consumers.rejected + self._consumers.inbox.garbage + self._tap.rejected,
        }


LATEST = 1 << 63
"""Stamps are below it, and not below its negative [ns]."""


def check_sent(topic: str, node: str, message_type: type[Message], message: Message) -> None:
    """Raises BusError for a message that a node must not publish on a topic: of another type, without a stamp in whole
    nanoseconds, or one sent before.
    """
    if type(message) is not message_type:
        raise BusError(f"topic {topic}: {node} declared {message_type.__name__} and published {type(message).__name__}")
    stamp = getattr(message.header, "stamp_ns", None)
    if (type(stamp) is not int and not isinstance(stamp, np.integer)) or not -LATEST <= stamp < LATEST:
        raise BusError(f"topic {topic}: {node} published the stamp {stamp!r:.80}; it must be int64, in nanoseconds")
    if message._slot is not None:
        raise BusError(
            f"topic {topic}: {node} published a message that came from the bus or was published before: "
            "make a new one (dataclasses.replace with a new header)"
        )
