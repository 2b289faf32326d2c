"""Tracks the declared consumers of a topic for its publisher: which are connected, which have credit, which hold which
slot."""

from __future__ import annotations

import contextlib
import os
import time
from dataclasses import dataclass, field

import zmq

from evis.bus import wire
from evis.bus.errors import BusError, PeerLost
from evis.bus.memory.slots import Pinned, reserve
from evis.bus.pipes import CreditInbox, Outlet
from msgs.header import Message

LAST_WORD_S = 0.25
"""Wait for a consumer's answer to the end after it has left: the two come over two connections, in any order [s]."""
MAX_KEYS = 4096
"""Private subscriptions remembered; there is one per consumer unless somebody floods the socket."""


@dataclass
class Consumer:
    """Describes one declared consumer.

    `held`: message -> its slot, until freed; `uncredited`: messages it has not taken yet.
    """

    name: str
    window: int
    route: bytes = b""
    link: int = 0
    key: bytes = b""
    shared: bool | None = None
    """Can it open our memory? None until it has said so."""
    gpu: str = ""
    """The GPU on which it takes arrays where they lie, by its UUID."""
    outlet: Outlet | None = None
    room: int = 0
    """Longest record that its pipe takes [bytes]; 0: it has none, and gets its messages over the socket."""
    answers: bool = False
    """Its credits come through the pipe."""
    uncredited: set[int] = field(default_factory=set)
    held: dict[int, Pinned | None] = field(default_factory=dict)
    ended: bool = False
    gone_at: float = 0.0
    greeted: bool = False
    """It has been counted in by `arrivals`."""

    @property
    def connected(self) -> bool:
        """Tells whether it has said if it can open our memory."""
        return self.shared is not None

    def forget(self) -> None:
        """Releases all slots that a departed consumer held, and forgets its connection."""
        for slot in self.held.values():
            if slot is not None:
                slot.unpin()
        self.held.clear()
        self.uncredited.clear()
        if self.outlet is not None:
            self.outlet.close()
        self.outlet, self.room, self.answers = None, 0, False
        self.route, self.link, self.key, self.shared, self.greeted = b"", 0, b"", None, False


class Consumers:
    """Talks with the consumers of one topic: by XPUB (who comes and goes), ROUTER (greetings) and pipe (credits)."""

    def __init__(
        self, topic: str, node: str, names: list[str], message_type: type[Message], window: int, piped: bool
    ) -> None:
        """Takes names and limits of a topic's declared consumers.

        topic, node: names of the topic and of its publisher. names: ids `node:port` of the declared consumers.
        message_type: what a consumer must expect. window: messages that each may be behind. piped: messages may go
        through pipes, where a consumer can be reached that way.
        """
        self.topic = topic
        self.node = node
        self.message_type = message_type
        self.window = window
        self.piped = piped
        self.inbox = CreditInbox()
        self.all = {name: Consumer(name, window) for name in names}
        self.rejected = 0
        self.finishing = False
        self._keys: set[bytes] = set()
        self._routes: dict[bytes, Consumer] = {}
        self._links: dict[int, Consumer] = {}
        self._token = os.urandom(16)
        self._probe = -1
        self._lost: list[Consumer] = []

    def attach(self, router: zmq.Socket) -> None:
        """Sets the bound ROUTER by which to answer."""
        self._router = router

    def missing(self) -> list[str]:
        """Lists the declared consumers that are not connected now."""
        return [c.name for c in self.all.values() if not self._present(c)]

    def _present(self, consumer: Consumer) -> bool:
        return consumer.connected and consumer.key in self._keys

    def arrivals(self) -> list[Consumer]:
        """Lists the consumers that became connected since the last call."""
        new = [c for c in self.all.values() if not c.greeted and self._present(c)]
        for consumer in new:
            consumer.greeted = True
        return new

    def room(self) -> int:
        """Returns the longest record that every consumer's pipe takes [bytes]; 0 when a consumer has no pipe."""
        return min([c.room for c in self.all.values()], default=1 << 30)

    def credit(self) -> int:
        """Returns how many messages every consumer has room for."""
        return min([c.window - len(c.uncredited) if c.greeted else 0 for c in self.all.values()], default=1 << 30)

    def behind(self) -> list[str]:
        """Lists the consumers without credit."""
        return [c.name for c in self.all.values() if not c.greeted or len(c.uncredited) >= c.window]

    def shared(self) -> bool:
        """Tells whether no consumer has said that it cannot open our memory."""
        return all(c.shared is not False for c in self.all.values())

    def charge(self, consumers: list[Consumer], seq: int, slot: Pinned | None) -> None:
        """Records a message on its way to consumers: it takes a credit of each, and each holds the slot."""
        for consumer in consumers:
            consumer.uncredited.add(seq)
            consumer.held[seq] = slot
            if slot is not None:
                slot.pin()

    def raise_lost(self) -> None:
        """Raises PeerLost for a consumer that has left before the end."""
        while self._lost:
            consumer = self._lost.pop()
            if not consumer.ended and not consumer.gone_at:
                self._routes.pop(consumer.route, None)
                self._links.pop(consumer.link, None)
                consumer.forget()
                raise PeerLost(consumer.name, self.topic)

    def handle_xpub(self, frames: list[bytes]) -> None:
        """Handles a message of the XPUB socket: a consumer has come or gone."""
        key = frames[0][1:]
        if len(frames) != 1 or frames[0][:1] not in (b"\0", b"\1") or len(key) > 512:
            self.rejected += 1
        elif not key.startswith(b"!"):
            return  # the topic itself
        elif frames[0][0]:
            if len(self._keys) < MAX_KEYS:
                self._keys.add(key)
            else:
                self.rejected += 1
        else:
            self._keys.discard(key)
            for consumer in self.all.values():
                if consumer.key == key:
                    if self.finishing:
                        consumer.gone_at = time.monotonic()
                    self._lost.append(consumer)

    def wait_for_credits(self, timeout_ms: int) -> bool:
        """Waits a little for credits through the pipe, where all consumers use it, and handles them; False when none
        came."""
        if not all([c.answers for c in self.all.values()]) or not self.inbox.wait(min(timeout_ms, wire.SOON_MS)):
            return False
        self.collect()
        return True

    def collect(self) -> None:
        """Handles the credits that came through the pipe."""
        for link, op, seq in self.inbox.take(self._links):
            consumer = self._links[link]
            try:
                self._credit(consumer, op, seq)
                consumer.answers = True
            except wire.Malformed:
                self.rejected += 1

    def handle_router(self, frames: list[bytes]) -> None:
        """Handles a message of the ROUTER: a greeting, or a credit of a consumer whose pipe is out of reach or full.

        Raises BusError for a consumer of another message type.
        """
        self.collect()
        if len(frames) != 2:
            self.rejected += 1
            return
        route, frame = frames
        try:
            consumer = self._routes.get(route)
            op = frame[:1]
            if op == wire.HELLO:
                self._hello(route, frame)
            elif consumer is None or consumer.route != route:
                raise wire.Malformed("no hello yet")
            elif op == wire.READY:
                self._ready(consumer, *wire.unpack_map(frame, shared=bool, pipe=list, gpu=str))
            elif op == wire.ENDED:
                consumer.ended = True
                consumer.uncredited.clear()
            else:
                self._credit(consumer, *wire.unpack_seq(frame))
        except wire.Malformed:
            self.rejected += 1

    def _credit(self, consumer: Consumer, op: bytes, seq: int) -> None:
        if seq not in consumer.held or (op != wire.FREED and seq not in consumer.uncredited):
            raise wire.Malformed("credit for a message that it does not have")
        if op not in (wire.CREDIT, wire.TAKEN, wire.FREED):
            raise wire.Malformed("unknown operation")
        consumer.uncredited.discard(seq)
        if op != wire.TAKEN:
            slot = consumer.held.pop(seq)
            if slot is not None:
                slot.unpin()

    def _ready(self, consumer: Consumer, shared: bool, address: list[int], gpu: str) -> None:
        if consumer.shared is not None:
            raise wire.Malformed("was ready before")
        consumer.shared, consumer.gpu = shared, gpu
        if shared and self.piped:
            with contextlib.suppress(OSError):  # then it gets its messages over the socket
                consumer.outlet = Outlet(address)
                consumer.room = consumer.outlet.room(consumer.window)

    def _hello(self, route: bytes, frame: bytes) -> None:
        name, token, theirs, window = wire.unpack_map(frame, id=str, token=str, type=str, window=int)
        consumer = self.all.get(name)
        ours = wire.type_name(self.message_type)
        if consumer is None:
            self._refuse(route, f"topic {self.topic}: {name!r:.80} is not a declared consumer of {self.node}")
        elif consumer.route:
            self._refuse(route, f"topic {self.topic}: {name} is connected already")
        elif theirs != ours:
            text = f"topic {self.topic}: {self.node} publishes {ours}, {name} expects {theirs:.80}"
            self._refuse(route, text)
            raise BusError(text)
        elif window < 1:
            raise wire.Malformed("window")
        else:
            consumer.route = route
            consumer.key = wire.private_key(name, token)
            consumer.window = min(self.window, window)
            self._routes[route] = consumer
            consumer.link = self._new_link()
            self._links[consumer.link] = consumer
            if self._probe < 0:
                self._probe = reserve(self.topic, len(self._token))
                os.pwrite(self._probe, self._token, 0)
            welcome = wire.pack_map(
                wire.WELCOME, node=self.node, type=ours, pid=os.getpid(), fd=self._probe, token=self._token,
                credits=self.inbox.address, link=consumer.link,
            )  # fmt: skip
            self._router.send_multipart([route, welcome])

    def _new_link(self) -> int:
        """Makes a number for a connection that random bytes do not hit and that no earlier connection had."""
        return int.from_bytes(os.urandom(4), "little") | 1

    def _refuse(self, route: bytes, reason: str) -> None:
        self.rejected += 1
        self._router.send_multipart([route, wire.pack_map(wire.REFUSED, reason=reason)])

    def unfinished(self, heard_at: float) -> bool:
        """Tells whether some consumers have not answered the end of the stream. Raises PeerLost for one that left
        before.

        heard_at: time.monotonic() before the sockets were last read. Time that passed since tells nothing: this process
        may have been held up with the answer in its queue.
        """
        waiting = [c for c in self.all.values() if not c.ended]
        for consumer in waiting:
            if consumer.gone_at and heard_at - consumer.gone_at > LAST_WORD_S:
                consumer.forget()
                raise PeerLost(consumer.name, self.topic)
        return bool(waiting)

    def close(self) -> None:
        """Frees every slot that is still held."""
        for consumer in self.all.values():
            consumer.forget()
        self.inbox.close()
        if self._probe >= 0:
            os.close(self._probe)
            self._probe = -1
