"""Sends topics of a running graph to followers on other hosts."""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping

import zmq
from zmq.auth.thread import ThreadAuthenticator

from evis.bus import Subscriber, endpoints_for, wire
from evis.bus.errors import BusError
from evis.remote import protocol
from evis.remote.keys import KeyPair
from evis.runtime.plan import Plan
from evis.runtime.process.control import ask_for
from msgs.codec import Buffer, encode
from msgs.header import Message
from msgs.topics import find_topic

QUEUE = 128
"""Messages that wait for a follower; what a slower one would have wait beyond it is lost to it, and it counts that."""
_LONGEST_ASKED = 4096
"""Longest frame that is accepted of a follower [bytes], unless a topic has a longer name; who sends more is
disconnected."""
_LOOK_MS = 100
_END_WAIT_S = 1.0
"""Longest wait for followers whose queue is full when the graph has ended [s]."""
_LINGER_MS = 2000
_MOST_TOLD = 10
"""Refused peers that a line is written of; the others are counted, for whoever knocks may knock without end."""
_MOST_AT_ONCE = 1000
"""Peers that may come between two looks; of more, lines are written of the last alone."""
_AGAIN_S = 0.005
"""Wait before a full queue is tried again [s]."""


class _Followers:
    """Admits those whose public keys are known. Called by the thread of ZeroMQ's authenticator."""

    def __init__(self, allowed: Mapping[bytes, str]) -> None:
        self._allowed = allowed
        self.counts: Counter[str] = Counter(admitted=0, refused=0)
        """Peers so far; written by the authenticator's thread alone."""
        self.came: deque[tuple[str, bool]] = deque(maxlen=_MOST_AT_ONCE)
        """Name of each peer that came and was not told of yet, and whether it was admitted."""

    def callback(self, domain: str, key: bytes) -> bool:
        """Tells whether the owner of a public key may connect."""
        admitted = key in self._allowed
        self.counts["admitted" if admitted else "refused"] += 1
        self.came.append((self._allowed.get(key, key.decode()), admitted))
        return admitted


class Server:
    """Reads topics of a graph by taps, each as long as a follower wants it, and sends what it read.

    plan: what followers are told of the graph, with the topics that are offered. address: tcp://HOST:PORT, * = any.
    key: its own. allowed: public keys of the followers, and a name of each for messages. Raises BusError.
    `counters`: sent, lost (between graph and server), admitted, refused (peers), rejected (what was no subscription).
    """

    def __init__(self, plan: Plan, address: str, key: KeyPair, allowed: Mapping[bytes, str]) -> None:
        self.counters: Counter[str] = Counter(dict.fromkeys(("sent", "lost", "admitted", "refused", "rejected"), 0))
        self._plan = plan
        self._epoch = os.urandom(4).hex().encode()
        self._hello = protocol.Hello(self._epoch, plan).pack()
        self._followers = _Followers(allowed)
        self._refusals_told = 0
        self._taps: dict[str, Subscriber] = {}
        self._numbers: Counter[str] = Counter()
        self._wanted: Counter[str] = Counter()
        self._eager: Counter[str] = Counter()
        self._latched: dict[str, list[Buffer]] = {}
        """Last message of a latched topic that is read, for who comes later."""
        self._topics = protocol.taps_of(plan)
        self._message_keys = {protocol.message_key(self._epoch, name): name for name in self._topics}
        self._every_keys = {protocol.every_key(self._epoch, name): name for name in self._topics}
        self._context = zmq.Context()
        self._authenticator = ThreadAuthenticator(self._context)
        self._authenticator.start()
        self._authenticator.configure_curve_callback(credentials_provider=self._followers)
        try:
            self._socket = self._bound(address, key)
        except BusError:
            self.close()
            raise
        self.address = str(self._socket.getsockopt_string(zmq.LAST_ENDPOINT))
        self._poller = wire.poller(self._socket)

    def _bound(self, address: str, key: KeyPair) -> zmq.Socket:
        sock = wire.open_socket(self._context, zmq.XPUB, QUEUE)
        protocol.prepare(sock, address, key)
        sock.setsockopt(zmq.HEARTBEAT_IVL, protocol.HEARTBEAT_MS)
        sock.setsockopt(zmq.HEARTBEAT_TIMEOUT, protocol.HEARTBEAT_TIMEOUT_MS)
        sock.setsockopt(zmq.MAXMSGSIZE, max(_LONGEST_ASKED, 2 * max(map(len, self._every_keys), default=0)))
        sock.curve_server = True
        try:
            sock.bind(address)
        except zmq.ZMQError as error:
            reason = zmq.strerror(error.errno or 0)
            raise BusError(
                f"cannot offer anything at {address}: {reason}; it must be a numeric address of this host, or *, and "
                "a port that is free"
            ) from None
        return sock

    def run(self, alive: Callable[[], bool], say: Callable[[str], None]) -> None:
        """Serves as long as `alive` says so.

        say: takes a line for a person. Raises BusError.
        """
        while alive():
            self.serve(_LOOK_MS)
            while self._followers.came:
                name, admitted = self._followers.came.popleft()
                if admitted:
                    say(f"{name} has connected")
                elif self._refusals_told < _MOST_TOLD:
                    self._refusals_told += 1
                    say(f"refused a peer: no --allow has its public key, {name}")
            self.counters.update({name: n - self.counters[name] for name, n in self._followers.counts.items()})
        self.serve(0)

    def serve(self, timeout_ms: int) -> None:
        """Waits for something, and hands on what has come."""
        self._poller.poll(timeout_ms)
        changed: set[str] = set()
        while wire.readable(self._socket):
            changed |= self._asked(self._socket.recv_multipart())
        for name in changed:
            self._settle(name)
        for name, tap in list(self._taps.items()):
            while (message := tap.receive(0)) is not None:
                if isinstance(message, Message):
                    self._send(name, encode(message), tap.every)
                else:
                    self._send(name, [wire.END_HEADER], tap.every)
                    break

    def _asked(self, frames: list[bytes]) -> set[str]:
        """Takes in a subscription, or its end; returns the topics that are wanted otherwise now."""
        asked, key = frames[0][:1] == b"\1", frames[0][1:]
        if len(frames) != 1 or frames[0][:1] not in (b"\0", b"\1"):
            self.counters["rejected"] += 1
        elif key[:1] == protocol.GREETING:
            if asked:
                wire.send(self._socket, [key, self._hello])
        elif key in self._message_keys:
            name = self._message_keys[key]
            self._wanted[name] = max(0, self._wanted[name] + (1 if asked else -1))
            if asked and name in self._latched:
                self._send(name, self._latched[name], self._taps[name].every)
            return {name}
        elif key in self._every_keys:
            name = self._every_keys[key]
            self._eager[name] = max(0, self._eager[name] + (1 if asked else -1))
            return {name}
        return set()

    def _settle(self, name: str) -> None:
        """Begins or ends to read a topic, as it is wanted now."""
        every = self._eager[name] > 0
        if name in self._taps and (not self._wanted[name] or self._taps[name].every != every):
            self._forget(name)
        if not self._wanted[name] or name in self._taps:
            return
        topic = self._topics[name]
        if topic in self._plan.topics and self._plan.nodes[self._plan.topics[topic].node].dormant:
            ask_for(self._plan.directory, topic)
        # A new one where it was read at another rate: it asks for every message from its first on, or for none.
        tap = Subscriber(
            self._context, topic, "remote", "tap", endpoints_for(self._plan.directory, name),
            message_type=find_topic(topic).type, tap=True, every=every,
        )  # fmt: skip
        tap.start()
        self._taps[name] = tap
        self._poller.register(tap.socket, zmq.POLLIN)

    def _forget(self, name: str) -> None:
        tap = self._taps.pop(name)
        self._latched.pop(name, None)
        self._poller.unregister(tap.socket)
        self.counters["lost"] += tap.lost if tap.every else 0
        tap.close()

    def _send(self, name: str, frames: list[Buffer], every: bool) -> None:
        if find_topic(self._topics[name]).latched and frames[0] != wire.END_HEADER:
            self._latched[name] = [bytes(frame) for frame in frames]
        # Otherwise libzmq looks at what the peers have taken only now and then, and drops by what it knew before.
        self._socket.getsockopt(zmq.EVENTS)
        key = protocol.message_key(self._epoch, name)
        wire.send(self._socket, [key, protocol.pack_mark(self._numbers[name], every), *frames])
        self._numbers[name] += 1
        self.counters["sent"] += frames[0] != wire.END_HEADER

    def end(self) -> None:
        """Tells all followers that the graph has ended; waits _END_WAIT_S for those that are behind."""
        self._socket.setsockopt(zmq.XPUB_NODROP, 1)
        deadline = time.monotonic() + _END_WAIT_S
        while True:
            try:
                self._socket.send_multipart([protocol.END, protocol.pack_end(self._epoch)], zmq.NOBLOCK)
                return
            except zmq.Again:
                if time.monotonic() > deadline:
                    self._socket.setsockopt(zmq.XPUB_NODROP, 0)
                else:
                    time.sleep(_AGAIN_S)

    def close(self) -> None:
        """Ends all reading, and the connections once what is under way has been sent."""
        for name in list(self._taps):
            self._forget(name)
        self._authenticator.stop()
        self._context.destroy(linger=_LINGER_MS)
