"""The receiving end of a topic."""

from __future__ import annotations

import enum
import os
import time
from typing import Final

import zmq
from zmq.utils.monitor import recv_monitor_message

from evis.bus import mapping, wire
from evis.bus.endpoints import Endpoints
from evis.bus.errors import BusError, PeerLost
from evis.bus.tap import queue_length
from msgs.codec import WireHeader, attach, decode_header
from msgs.fields import MessageError, TypeMismatch
from msgs.header import Message


class End(enum.Enum):
    """What `receive` returns when the publisher has ended the stream."""

    END = "end of stream"


END: Final = End.END


class Lease:
    """Hold on a received message. The first `unpin` returns the credit; when no pin is left its slot may be reused."""

    __slots__ = ("_credited", "_pins", "_seq", "_subscriber")

    def __init__(self, subscriber: Subscriber, seq: int) -> None:
        self._subscriber = subscriber
        self._seq = seq
        self._pins = 1
        self._credited = False

    def pin(self) -> None:
        """Keep the arrays valid for one more user."""
        if not self._pins:
            raise BusError(f"topic {self._subscriber.topic}: a message was kept after its release")
        self._pins += 1

    def unpin(self) -> None:
        """One user less."""
        if not self._pins:
            raise BusError(f"topic {self._subscriber.topic}: a message was released more often than it was kept")
        self._pins -= 1
        if not self._pins:
            self._subscriber.reply(wire.FREED if self._credited else wire.CREDIT, self._seq)
        elif not self._credited:
            self._credited = True
            self._subscriber.reply(wire.TAKEN, self._seq)


class Subscriber:
    """Receives one topic: without loss as a declared consumer `node:port`, or (tap) as much as comes through.

    window: messages it lets the publisher be ahead. `lost`: messages missed, by their sequence numbers; `rejected`:
    what came and was no message. All calls are from one thread. Raises BusError and PeerLost.
    """

    def __init__(
        self,
        context: zmq.Context,
        topic: str,
        node: str,
        port: str,
        endpoints: Endpoints,
        *,
        message_type: type[Message],
        tap: bool = False,
        window: int = 2,
    ) -> None:
        self.topic = topic
        self.name = f"{node}:{port}"
        self.endpoints = endpoints
        self.message_type = message_type
        self.tap = tap
        self.lost = 0
        self.rejected = 0
        self.received = 0
        self.publisher = "the publisher"
        """Its node name, once connected."""
        self._context = context
        self._window = window
        self._frame = topic.encode()
        self._reader = mapping.SlotReader()
        self._next_seq: int | None = None
        self._last: tuple[int, int] | None = None
        self._ready = False
        self._ended = False
        self._disconnected = False
        self._sockets: list[zmq.Socket] = []

    @property
    def socket(self) -> zmq.Socket:
        """For a poller: call `receive` when it is readable."""
        return self._data

    def sockets(self) -> list[zmq.Socket]:
        """`socket`, and those that show a refusal or the loss of the publisher."""
        return self._sockets

    def start(self) -> None:
        """Connect; the publisher need not be there yet."""
        token = os.urandom(8).hex()
        self._data = self._open(zmq.SUB, queue_length(self.topic) if self.tap else 0)
        # Monitored from before the connection is made: a publisher that dies shows as a disconnection.
        self._monitor = self._data.get_monitor_socket(zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_SUCCEEDED)
        self._sockets.append(self._monitor)
        self._poller = wire.poller(self._data)
        self._events = wire.poller(self._monitor)
        self._data.connect(self.endpoints.tap if self.tap else self.endpoints.lockstep)
        self._data.setsockopt(zmq.SUBSCRIBE, self._frame)
        self._key = wire.private_key(self.name, token)
        self._data.setsockopt(zmq.SUBSCRIBE, self._key)
        if not self.tap:
            self._dealer = self._open(zmq.DEALER)
            self._greeting = wire.poller(self._dealer)
            self._dealer.connect(self.endpoints.credit)
            kind = wire.type_name(self.message_type)
            self._dealer.send(wire.pack_map(wire.HELLO, id=self.name, token=token, type=kind, window=self._window))

    def _open(self, kind: int, high_water_mark: int = 0) -> zmq.Socket:
        sock = wire.open_socket(self._context, kind, high_water_mark)
        self._sockets.append(sock)
        if self.endpoints.server_key:
            public, secret = zmq.curve_keypair()
            sock.setsockopt_string(zmq.CURVE_SERVERKEY, self.endpoints.server_key)
            sock.setsockopt(zmq.CURVE_PUBLICKEY, public)
            sock.setsockopt(zmq.CURVE_SECRETKEY, secret)
        return sock

    def connected(self) -> bool:
        """True once the publisher has welcomed this consumer (a tap: once the connection stands). Raises BusError."""
        if self.tap:
            self._watch()
        elif not self._ready:
            self._greet()
        return self._ready

    def _greet(self) -> None:
        while self._greeting.poll(0):
            frame = self._dealer.recv()
            try:
                if frame[:1] == wire.REFUSED:
                    raise BusError(wire.unpack_map(frame, reason=str)[0])
                if frame[:1] != wire.WELCOME:
                    raise wire.Malformed("not a welcome")
                self.publisher, pid, fd, token = wire.unpack_map(frame, node=str, pid=int, fd=int, token=bytes)
            except wire.Malformed:
                self.rejected += 1
                continue
            shared = self.endpoints.lockstep.startswith("ipc://") and mapping.reachable(pid, fd, token)
            self._dealer.send(wire.pack_map(wire.READY, shared=shared))
            self._ready = True

    def receive(self, timeout_ms: int = 0) -> Message | End | None:
        """The next message, END after the last, None when nothing has come within timeout_ms.

        The message holds one pin; `message.release()` returns the credit. Its arrays may be read-only views of the
        publisher's memory. Raises BusError for a message of the wrong type or shape, naming both sides.
        """
        if not self._ready and not self.tap:
            timeout_ms = self._wait_for_welcome(timeout_ms)
        while self._poller.poll(timeout_ms):
            timeout_ms = 0
            frames = self._data.recv_multipart()
            if len(frames) < 2 or (frames[0] != self._frame and frames[0] != self._key):
                self.rejected += 1
            elif frames[1] == wire.END_HEADER:
                return self._end(frames)
            elif (message := self._message(frames)) is not None:
                return message
        return None

    def _wait_for_welcome(self, timeout_ms: int) -> int:
        """The welcome comes before the first message. Returns what is left of the time."""
        deadline = time.monotonic() + timeout_ms / 1000
        while not self._ready:
            if not self._greeting.poll(max(0, int(1000 * (deadline - time.monotonic())))):
                return 0
            self._greet()
        return max(0, int(1000 * (deadline - time.monotonic())))

    def _end(self, frames: list[bytes]) -> End:
        if len(frames) == 3 and len(frames[2]) == 8:
            self._count(int.from_bytes(frames[2], "little"))
        self._ended = True
        if not self.tap:
            self._dealer.send(wire.ENDED)
        return END

    def _message(self, frames: list[bytes]) -> Message | None:
        try:
            head = decode_header(frames[1], self.message_type)
            message = attach(head, self._buffers(head, frames))
        except MessageError as error:
            self.rejected += 1
            if self.tap and not isinstance(error, TypeMismatch):
                return None
            raise BusError(f"topic {self.topic}, from {self.publisher} to {self.name}: {error}") from None
        except OSError:
            raise PeerLost(self.publisher, self.topic, "closed the memory of a message under way") from None
        if (head.header.seq, head.header.stamp_ns) == self._last:
            # A latched value both broadcast and resent while we were connecting. Its credit goes back, if it took one.
            if not self.tap:
                self.reply(wire.CREDIT, head.header.seq)
            return None
        self._count(head.header.seq)
        self._next_seq = head.header.seq + 1
        self._last = head.header.seq, head.header.stamp_ns
        self.received += 1
        if not self.tap:
            message._slot = Lease(self, head.header.seq)  # type: ignore[misc]
        return message

    def _buffers(self, head: WireHeader, frames: list[bytes]) -> list[bytes] | list[memoryview]:
        slot = head.extra.get("slot")
        if slot is None:
            return frames[2:]
        if self.tap or len(frames) != 2:
            raise MessageError(f"{head.message_type.__name__}: a slot descriptor where the arrays should be")
        return self._reader.buffers(head, slot)

    def _count(self, seq: int) -> None:
        if self._next_seq is not None and seq > self._next_seq:
            self.lost += seq - self._next_seq

    def reply(self, op: bytes, seq: int) -> None:
        """Called by a lease: tell the publisher."""
        if self._sockets and not self._disconnected:
            self._dealer.send(wire.pack_seq(op, seq))

    def _watch(self) -> None:
        while self._events.poll(0):
            up = recv_monitor_message(self._monitor)["event"] == zmq.EVENT_HANDSHAKE_SUCCEEDED
            if self.tap:  # a tap may come back to a publisher that was started again
                self._ready = up
            self._disconnected = not up if self.tap else self._disconnected or not up

    def raise_if_publisher_lost(self) -> None:
        """Raise PeerLost when the publisher went away before the end of the stream and all that came is received."""
        self._watch()
        if self._disconnected and not self._ended and not self._poller.poll(0):
            raise PeerLost(self.publisher, self.topic)

    def close(self) -> None:
        """Disconnect. Arrays of messages that are kept stay readable."""
        if self._sockets:
            self._data.disable_monitor()
        for sock in self._sockets:
            sock.close(linger=1000 if sock.type == zmq.DEALER and self._ended else 0)
        self._sockets = []
