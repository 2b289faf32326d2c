"""Implements the receiving end of a topic."""

from __future__ import annotations

import contextlib
import os
import struct
import time
from collections import deque
from typing import Any

import zmq

from evis.bus import wire
from evis.bus.endpoints import Endpoints
from evis.bus.errors import BusError, PeerLost
from evis.bus.lease import END, End, Lease
from evis.bus.memory import mapping
from evis.bus.memory.cuda_ipc import KIND, ImportedSlots, uuid_of, without_rows
from evis.bus.memory.device import device_of
from evis.bus.pipes import MessageInbox, Outlet
from evis.bus.tap import queue_length, together
from msgs.codec import attach, decode_header
from msgs.fields import MessageError, TypeMismatch
from msgs.header import Message, missed_between

TAP_QUEUE = 64
"""Messages that wait in a tap's socket while nobody reads it: far more than it may lag behind, for libzmq 4.3.5 aborts
the process when a publisher goes away while the queue of a socket is full."""
_MONITORED = struct.Struct("=Hi")


class Subscriber:
    """Receives one topic: without loss as a declared consumer `node:port`, or (tap) as far as it follows.

    context: of ZeroMQ, the process's. topic, node, port: names. endpoints: the publisher's addresses. message_type: the
    only one that it takes. window: messages it lets the publisher be ahead. every: a tap that asks for every message,
    not at the rate of a viewer. device: a Warp device on which arrays of another process may stay.
    All calls are from one thread.
    `lost`: messages missed, by their sequence numbers; `rejected`: what came and was no message.
    Raises BusError and PeerLost.
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
        every: bool = False,
        window: int = 2,
        device: str = "",
    ) -> None:
        self.topic = topic
        self.name = f"{node}:{port}"
        self.endpoints = endpoints
        self.message_type = message_type
        self.tap = tap
        self.every = every
        self.lost = 0
        self.rejected = 0
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
        self._received: deque[list[bytes]] = deque(maxlen=queue_length(topic))
        """What a tap has received: of what it lags behind, the newest."""
        self._envs = 1
        """Environments that a tap has room for."""
        self._inbox: MessageInbox | None = None
        self._piped = False
        """Messages come through the pipe: it announces even those that do not."""
        self._elsewhere = False
        """The next message comes over the socket: so the pipe has said."""
        self._credits: Outlet | None = None
        self._link = 0
        self._device = device
        self._imported: ImportedSlots | None = None
        """Where the arrays come that stay on a GPU."""
        self._on_gpu = 0
        """Messages with such arrays that are not freed."""
        self._reading: deque[tuple[int, Any]] = deque()
        """Those of them that were released, and the events behind what reads them."""
        self._end_owed = False

    @property
    def socket(self) -> zmq.Socket:
        """Returns the only socket on which a tap receives messages, for a poller: call `receive` when it is
        readable."""
        return self._data

    def sockets(self) -> list[zmq.Socket | int]:
        """Lists sockets and a file descriptor for a poller: when one is readable, call `receive` until it returns None.

        Then `raise_if_publisher_lost`: it takes in what `signals` shows.
        """
        return [self._data, *([] if self._inbox is None else [self._inbox.fileno()]), *self.signals()]

    def signals(self) -> list[zmq.Socket | int]:
        """Lists those of `sockets` that carry no messages: a welcome or refusal, the loss of the publisher.

        A tap has none.
        """
        if self.tap:
            return []
        return [self._monitor] if self._ready else [self._monitor, self._dealer]

    def start(self) -> None:
        """Connects the sockets; the publisher need not be there yet."""
        token = os.urandom(8).hex()
        self._data = self._open(zmq.SUB, TAP_QUEUE if self.tap else 0)
        # Monitored from before the connection is made: a publisher that dies shows as a disconnection.
        self._monitor = self._data.get_monitor_socket(zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_SUCCEEDED)
        self._sockets.append(self._monitor)
        self._poller = wire.poller(self._data)
        if not self.tap:
            self._inbox = MessageInbox(self._window)
            self._either = wire.poller(self._data, self._inbox.fileno())
        self._data.connect(self.endpoints.tap if self.tap else self.endpoints.lockstep)
        if self.every:
            self._data.setsockopt(zmq.SUBSCRIBE, wire.EVERY)
        self._data.setsockopt(zmq.SUBSCRIBE, self._frame)
        self._key = wire.private_key(self.name, token)
        self._data.setsockopt(zmq.SUBSCRIBE, self._key)
        if not self.tap:
            self._dealer = self._open(zmq.DEALER)
            self._greeting = wire.poller(self._dealer)
            self._dealer.connect(self.endpoints.credit)
            kind = wire.type_name(self.message_type)
            self._dealer.send(wire.pack_map(wire.HELLO, id=self.name, token=token, type=kind, window=self._window))

    def want_every(self, every: bool) -> None:
        """Sets whether a tap gets every message from now on, or those that the publisher's rate lets through."""
        self.every = every
        self._data.setsockopt(zmq.SUBSCRIBE if every else zmq.UNSUBSCRIBE, wire.EVERY)

    def _open(self, kind: int, high_water_mark: int = 0) -> zmq.Socket:
        sock = wire.open_socket(self._context, kind, high_water_mark)
        self._sockets.append(sock)
        return sock

    def connected(self) -> bool:
        """Tells whether the publisher has welcomed this consumer (of a tap: the connection stands). Raises BusError."""
        self._check_connection()
        if not self.tap and not self._ready:
            self._greet()
        return self._ready

    def _greet(self) -> None:
        while wire.readable(self._dealer):
            frame = self._dealer.recv()
            try:
                if frame[:1] == wire.REFUSED:
                    raise BusError(wire.unpack_map(frame, reason=str)[0])
                if frame[:1] != wire.WELCOME:
                    raise wire.Malformed("not a welcome")
                self.publisher, pid, fd, token, credits, self._link = wire.unpack_map(
                    frame, node=str, pid=int, fd=int, token=bytes, credits=list, link=int
                )
            except wire.Malformed:
                self.rejected += 1
                continue
            shared = self._inbox is not None and mapping.reachable(pid, fd, token)
            if shared and self._credits is None:
                with contextlib.suppress(OSError):  # then credits go over the socket
                    self._credits = Outlet(credits)
            address = [] if self._inbox is None else self._inbox.address
            gpu = uuid_of(self._device) if shared and pid != os.getpid() else ""  # no process opens its own memory
            if gpu and self._imported is None:
                self._imported = ImportedSlots(self._device)
            self._dealer.send(wire.pack_map(wire.READY, shared=shared, pipe=address, gpu=gpu))
            self._ready = True

    def receive(self, timeout_ms: int = 0) -> Message | End | None:
        """Returns the next message, END after the last, None when nothing has come within timeout_ms.

        The message holds one pin; `message.release()` returns the credit. Its arrays may be read-only views of the
        publisher's memory. Raises BusError for a message of the wrong type or shape, naming both sides.
        """
        if not self._ready and not self.tap:
            timeout_ms = self._wait_for_welcome(timeout_ms)
        self._free_past_gpu()
        deadline = time.monotonic() + timeout_ms / 1000
        # Who waits has most likely taken all that came: to wait first costs less than to read nothing first.
        if timeout_ms > 0 and self._piped and not self._elsewhere and self._inbox is not None:
            if not self._inbox.pending(timeout_ms):
                return None
        while True:
            frames = self._next_frames()
            if frames is None:
                left_ms = int(1000 * (deadline - time.monotonic()) + 0.999)
                if left_ms <= 0 or not self._wait(left_ms):
                    return None
            elif not frames:
                self.rejected += 1
            elif frames[0] == wire.END_HEADER:
                return self._accept_end(frames)
            elif (message := self._accept(frames)) is not None:
                return message

    def make_room(self) -> None:
        """Empties the socket of a tap, and drops the oldest of what was not received yet: a full one drops what comes.

        `receive` does so too; who does not call it for long may call this.
        """
        while wire.readable(self._data):
            if self._next_seq is None and len(self._received) == self._received.maxlen:
                self._count_from(self._received[0])
            self._received.append(self._data.recv_multipart())

    def _next_frames(self) -> list[bytes] | None:
        """Returns the frames of the next message, [] for invalid ones; None when nothing is there."""
        if self.tap:
            self.make_room()
            return self._frames_for_me(self._received.popleft()) if self._received else None
        if not self._elsewhere and (frames := self._from_pipe()):
            return frames
        if (self._piped and not self._elsewhere) or not wire.readable(self._data):
            return None
        if not self._elsewhere and (frames := self._from_pipe()):  # came in before what is in the socket
            return frames
        self._elsewhere = False
        return self._frames_for_me(self._data.recv_multipart())

    def _count_from(self, received: list[bytes]) -> None:
        """Counts losses from this message on: the oldest, which is dropped before any was read."""
        with contextlib.suppress(MessageError):  # it is no message of this topic
            if (frames := self._frames_for_me(received)) and frames[0] != wire.END_HEADER:
                self._next_seq = decode_header(frames[0], self.message_type).header.seq

    def _frames_for_me(self, received: list[bytes]) -> list[bytes]:
        topic, *frames = received
        return frames if topic in (self._frame, self._key) else []

    def _from_pipe(self) -> list[bytes] | None:
        if self._inbox is None:
            return None
        try:
            frames = self._inbox.take()
        except wire.Malformed as error:
            self.rejected += 1
            self._inbox.close()
            self._inbox = None
            raise BusError(f"topic {self.topic}: {self.name} cannot read what came through its pipe: {error}") from None
        self._piped = self._piped or frames is not None
        self._elsewhere = frames == []
        return frames

    def _wait(self, timeout_ms: int) -> bool:
        """Waits until there may be something to receive; False when the time is over."""
        if self._inbox is None or self._elsewhere:
            return bool(self._poller.poll(timeout_ms))
        return self._inbox.wait(timeout_ms) if self._piped else bool(self._either.poll(timeout_ms))

    def _wait_for_welcome(self, timeout_ms: int) -> int:
        """Waits for the welcome, which comes before the first message. Returns what is left of the time [ms]."""
        deadline = time.monotonic() + timeout_ms / 1000
        while not self._ready:
            if not self._greeting.poll(max(0, int(1000 * (deadline - time.monotonic())))):
                return 0
            self._greet()
        return max(0, int(1000 * (deadline - time.monotonic())))

    def _accept_end(self, frames: list[bytes]) -> End:
        if len(frames) == 2 and len(frames[1]) == 8:
            self._count(int.from_bytes(frames[1], "little"))
        self._ended = True
        self._end_owed = not self.tap
        self._free_past_gpu(wait=True)
        self._answer_end()
        return END

    def _accept(self, frames: list[bytes]) -> Message | None:
        try:
            message = self._reader.recall(frames) or self._decode(frames)
        except MessageError as error:
            self.rejected += 1
            if self.tap and not isinstance(error, TypeMismatch):
                return None
            raise BusError(f"topic {self.topic}, from {self.publisher} to {self.name}: {error}") from None
        except OSError:
            raise PeerLost(self.publisher, self.topic, "closed the memory of a message under way") from None
        header = message.header
        this = header.seq, header.stamp_ns
        if this == self._last:
            # A latched value both broadcast and resent while we were connecting. Its credit goes back, if it took one.
            if not self.tap:
                self.reply(wire.CREDIT, header.seq)
            return None
        if header.seq != self._next_seq:
            self._count(header.seq)
        self._next_seq = header.seq + 1
        self._last = this
        if self.tap:
            self._make_room_for(message.environment[1])
        else:
            on_gpu = device_of(message) is not None
            self._on_gpu += on_gpu
            message._slot = Lease(self, header.seq, on_gpu)  # type: ignore[misc]
        return message

    def _make_room_for(self, envs: int) -> None:
        """Lets a tap lag behind by as many messages of each environment, where each has its own."""
        if together(envs) > self._envs:
            self._envs = together(envs)
            self._received = deque(self._received, maxlen=queue_length(self.topic, envs))
            self._data.setsockopt(zmq.RCVHWM, TAP_QUEUE * self._envs)

    def _decode(self, frames: list[bytes]) -> Message:
        head = decode_header(frames[0], self.message_type)
        slot, on_gpu = head.extra.get("slot"), head.extra.get(KIND)
        if on_gpu is not None and not self.tap:
            return self._imported.attach(head, on_gpu) if self._imported is not None else without_rows(head)
        if slot is None:
            return attach(head, frames[1:])
        if self.tap:
            raise MessageError(f"{head.message_type.__name__}: a slot descriptor where the arrays should be")
        return self._reader.attach(head, slot, frames)

    def _count(self, seq: int) -> None:
        if self._next_seq is not None:
            self.lost += missed_between(self._next_seq - 1, seq)

    def reply(self, op: bytes, seq: int) -> None:
        """Tells the publisher what happened to a message; called by a lease."""
        if not self._sockets or self._disconnected:
            return
        if self._credits is None or not self._credits.write_credit(self._link, op, seq):
            self._dealer.send(wire.pack_seq(op, seq))

    def free_on_gpu(self, seq: int) -> None:
        """Frees a message once the GPU is past its last reader; called by a lease."""
        import warp as wp

        assert self._imported is not None
        self._reading.append((seq, self._imported.device.stream.record_event(wp.Event(self._imported.device))))
        if self._ended:
            self._free_past_gpu(wait=True)
            self._answer_end()

    def _free_past_gpu(self, wait: bool = False) -> None:
        """Frees the messages that the GPU is past; with `wait`, all that were released."""
        while self._reading and (wait or self._reading[0][1].is_complete):
            seq, passed = self._reading.popleft()
            if wait:
                import warp as wp

                wp.synchronize_event(passed)
            self._on_gpu -= 1
            self.reply(wire.FREED, seq)

    def _answer_end(self) -> None:
        """Answers the end of the stream, unless a node keeps messages whose memory on the GPU the publisher holds."""
        if self._end_owed and not self._on_gpu:
            self._end_owed = False
            if self._imported is not None:
                self._imported.close()
            self._dealer.send(wire.ENDED)

    def _check_connection(self) -> None:
        while wire.readable(self._monitor):
            up = _event_of(self._monitor.recv_multipart()) == zmq.EVENT_HANDSHAKE_SUCCEEDED
            if self.tap:  # a tap may come back to a publisher that was started again
                self._ready = up
            self._disconnected = not up if self.tap else self._disconnected or not up

    def raise_if_publisher_lost(self) -> None:
        """Raises PeerLost where the publisher left before the end and all that came is received."""
        self._check_connection()
        if self._disconnected and not self._ended and not self._pending():
            raise PeerLost(self.publisher, self.topic)

    def _pending(self) -> bool:
        return wire.readable(self._data) or (self._inbox is not None and self._inbox.pending())

    def close(self) -> None:
        """Disconnects. Arrays of kept messages stay readable, except those of another process on a GPU."""
        self._free_past_gpu(wait=True)
        self._on_gpu = 0
        self._answer_end()
        self._imported = None
        if self._sockets:
            self._data.disable_monitor()
        for sock in self._sockets:
            sock.close(linger=1000 if sock.type == zmq.DEALER and self._ended else 0)
        self._sockets = []
        for pipe in (self._inbox, self._credits):
            if pipe is not None:
                pipe.close()
        self._inbox = self._credits = None
        self._reader = mapping.SlotReader()


def _event_of(frames: list[bytes]) -> int:
    """Parses the event of a monitor's message: its first frame is the event, uint16, and a value
    (zmq_socket_monitor(3)).

    pyzmq's own reader imports asyncio and ssl, 60 ms of every process.
    """
    return int(_MONITORED.unpack(frames[0])[0])
