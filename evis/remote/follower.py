"""Makes the topics of a graph on another host those of a run on this one."""

from __future__ import annotations

import os
import struct
import time
from collections import Counter, deque
from collections.abc import Callable

import zmq

from evis.bus import wire
from evis.client.running import running_graphs
from evis.remote import protocol
from evis.remote.keys import KeyPair
from evis.remote.local_run import LocalRun, LocalTap
from msgs.codec import attach, decode_header
from msgs.fields import MessageError, TypeMismatch

FIRST_S = 10.0
"""Longest wait for the server at the start [s]."""
_QUEUE = 128
"""Messages that may wait here to be handed on; of more, the oldest are dropped, and counted as lost."""
_RECEIVED = 8 * _QUEUE
"""Messages that wait in the socket: far more, for libzmq 4.3.5 aborts the process when a server goes away while the
queue of a socket is full."""
_LONGEST = 1 << 30
"""Longest array that a server may send [bytes]."""
_FAILURES = 3
"""Handshakes that fail in a row before a first one succeeds: of a server without keys, the first says nothing."""
_LOOK_MS = 50
_AGAIN_MS, _AGAIN_AT_LAST_MS = 100, 2000
"""Time after which a connection is tried again, at first, and at most as it doubles with each failure."""
_PROBE_S, _GONE_S = 5, 60
"""Interval of the probes of a silent connection, and the time without an answer after which it is broken [s]."""
_EVENT = struct.Struct("=Hi")
_EVENTS = (
    zmq.EVENT_CONNECTED | zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
)  # fmt: skip


class Follower:
    """Reads topics of a graph on another host, each as long as it is read here, and offers them in a run of its own.

    address: of the server, tcp://HOST:PORT. key: its own. server: the server's public key. say: takes a line for a
    person. `counters`: messages, lost (on the way), rejected (what was no message), breaks (of the connection).
    """

    def __init__(self, address: str, key: KeyPair, server: bytes, say: Callable[[str], None]) -> None:
        self.counters: Counter[str] = Counter(dict.fromkeys(("messages", "lost", "rejected", "breaks"), 0))
        self.ended = False
        """Whether the graph has ended."""
        self.run: LocalRun | None = None
        """What is offered here, once the server has said what there is."""
        self._address, self._say = address, say
        self._epoch = b""
        self._keys: dict[bytes, LocalTap] = {}
        self._subscribed: dict[str, tuple[bool, bool]] = {}
        self._waiting: deque[list[bytes]] = deque()
        self._lost_before = 0
        """In runs that have ended."""
        self._broken_at = 0.0
        self._failures = 0
        self._answered = False
        self._context = zmq.Context()
        sock = wire.open_socket(self._context, zmq.SUB, _RECEIVED)
        protocol.prepare(sock, address, key)
        _watch_connection(sock)
        sock.setsockopt(zmq.RECONNECT_IVL, _AGAIN_MS)
        sock.setsockopt(zmq.RECONNECT_IVL_MAX, _AGAIN_AT_LAST_MS)
        sock.setsockopt(zmq.MAXMSGSIZE, _LONGEST)
        sock.curve_serverkey = server
        self._greeting = protocol.GREETING + os.urandom(8).hex().encode()
        self._socket, self._monitor = sock, sock.get_monitor_socket(_EVENTS)
        sock.setsockopt(zmq.SUBSCRIBE, protocol.END)
        sock.setsockopt(zmq.SUBSCRIBE, self._greeting)
        self._poller = wire.poller(sock, self._monitor)
        try:
            sock.connect(address)
        except zmq.ZMQError as error:
            self.close()
            raise ConnectionError(f"{address}: {zmq.strerror(error.errno or 0)}") from None

    def connect(self, asked_to_end: Callable[[], bool]) -> bool:
        """Waits for the server, FIRST_S at most; False where it was asked to end. Raises ConnectionError."""
        deadline = time.monotonic() + FIRST_S
        while self.run is None and not self.ended:
            if asked_to_end():
                return False
            self.follow()
            if self._failures >= _FAILURES or (self._answered and time.monotonic() > deadline):
                raise ConnectionRefusedError(
                    f"what answers at {self._address} is no `evis remote serve` with the key of --server, or one of "
                    "another release"
                )
            if time.monotonic() > deadline:
                raise ConnectionRefusedError(
                    f"nothing answers at {self._address}: is `evis remote serve` running there, and does each firewall "
                    "on the way let its port through?"
                )
        return True

    def follow(self) -> None:
        """Waits for something, and hands on what has come. Raises ConnectionError, BusError and OSError."""
        self._poller.poll(_LOOK_MS)
        while wire.readable(self._socket):
            if len(self._waiting) == _QUEUE:
                self._drop(self._waiting.popleft())
            self._waiting.append(self._socket.recv_multipart())
        while self._waiting and not self.ended:
            self._take(self._waiting.popleft())
        if not self.ended:  # which comes before the connection ends
            self._look_at_connection()
        if self.run is not None:
            self._subscribe(self.run)
            self.counters["lost"] = self._lost_before + sum(tap.lost for tap in self.run.taps.values())
            self.run.tell(self.counters)

    def _look_at_connection(self) -> None:
        while wire.readable(self._monitor):
            event = _EVENT.unpack(self._monitor.recv_multipart()[0])[0]
            self._answered = self._answered or event == zmq.EVENT_CONNECTED
            if event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                raise ConnectionRefusedError(
                    f"{self._address} does not know this key: its public half must be given there to "
                    "`evis remote serve --allow`"
                )
            if event in (zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL, zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL):
                self._failures += self.run is None
            if event == zmq.EVENT_DISCONNECTED and self.run is not None and not self._broken_at:
                self._broken_at = time.monotonic()
                self.counters["breaks"] += 1
                self._told(self.run, f"the connection to {self._address} is broken; waiting for it")

    def _told(self, run: LocalRun, line: str) -> None:
        self._say(line)
        run.tell(self.counters, "warning", line)

    def _take(self, frames: list[bytes]) -> None:
        if frames[0] == self._greeting and len(frames) == 2:
            try:
                self._greeted(protocol.Hello.unpack(frames[1]))
            except protocol.ProtocolError as error:
                raise protocol.ProtocolError(f"{self._address}: {error}") from None
        elif frames[0] == protocol.END and len(frames) == 2:
            self.ended = protocol.ended_epoch(frames[1]) == self._epoch
        elif frames[0] in self._keys:
            self._hand_on(self._keys[frames[0]], frames[1:])
        elif not frames[0].startswith(self._epoch):
            pass  # under way when another server had greeted: of an earlier run
        else:
            self.counters["rejected"] += 1

    def _greeted(self, hello: protocol.Hello) -> None:
        """Begins a run, or goes on with it where a server of the same graph was started again."""
        if self.run is not None and hello.plan.run_id != self.run.plan.run_id:
            self._say(f"{self._address} serves another run now, {hello.plan.run_id} ({hello.plan.name})")
            self._end_run()
        elif self.run is not None and self._broken_at:
            broken_s = time.monotonic() - self._broken_at
            self._told(self.run, f"connected again, after {broken_s:.1f} s; what {self._address} sent is missing")
        self._broken_at = 0.0
        if self.run is None:
            if any(plan.run_id == hello.plan.run_id for plan in running_graphs()):
                raise protocol.ProtocolError(f"the graph {hello.plan.run_id} is on this host already; read it here")
            self.run = LocalRun(self._context, hello.plan, self._address)
            for sock in self.run.sockets():
                self._poller.register(sock, zmq.POLLIN)
        if hello.epoch != self._epoch:
            self._unsubscribe()
            self._epoch = hello.epoch
            self._keys = {protocol.message_key(hello.epoch, name): tap for name, tap in self.run.taps.items()}
            for tap in self.run.taps.values():
                tap.renumbered()

    def _hand_on(self, tap: LocalTap, frames: list[bytes]) -> None:
        """Checks a message and hands it on, byte by byte as it came."""
        try:
            number, every = protocol.unpack_mark(frames[0])
            if frames[1] == wire.END_HEADER:
                tap.sender.end([wire.END_HEADER])
                return
            head = decode_header(frames[1], tap.type)
            if head.extra:
                raise MessageError("arrays in the memory of another host")
            message = attach(head, frames[2:])
        except TypeMismatch as error:
            raise protocol.ProtocolError(f"{self._address}, {tap.topic}: {error}") from None
        except (struct.error, IndexError, MessageError):
            self.counters["rejected"] += 1
            return
        tap.count(number, head.header.seq, every)
        self.counters["messages"] += 1
        tap.send(message, list(frames[1:]))

    def _drop(self, frames: list[bytes]) -> None:
        """Counts a message as lost, as too many are behind it; what is none, latched or the end is never dropped."""
        tap = self._keys.get(frames[0])
        if tap is None or tap.latched or frames[2:3] == [wire.END_HEADER]:
            self._take(frames)
            return
        try:
            number, every = protocol.unpack_mark(frames[1])
            tap.count(number, decode_header(frames[2], tap.type).header.seq, every)
            tap.lost += 1
        except (struct.error, IndexError, MessageError):
            self.counters["rejected"] += 1

    def _subscribe(self, run: LocalRun) -> None:
        """Wants of each topic what its readers here want; of latched ones all, so that who comes late has the last."""
        for name, tap in run.taps.items():
            wanted, every = tap.wanted()
            if tap.latched and not run.plan.nodes[run.plan.topics[tap.topic].node].dormant:
                wanted = True
            before, every_before = self._subscribed.get(name, (False, False))
            if every != every_before:
                option = zmq.SUBSCRIBE if every else zmq.UNSUBSCRIBE
                self._socket.setsockopt(option, protocol.every_key(self._epoch, name))
            if wanted != before:
                option = zmq.SUBSCRIBE if wanted else zmq.UNSUBSCRIBE
                self._socket.setsockopt(option, protocol.message_key(self._epoch, name))
            if not wanted:
                tap.rest()
            self._subscribed[name] = wanted, every

    def _unsubscribe(self) -> None:
        """Takes back all that was wanted of a server that is there no longer."""
        for name, (wanted, every) in self._subscribed.items():
            if every:
                self._socket.setsockopt(zmq.UNSUBSCRIBE, protocol.every_key(self._epoch, name))
            if wanted:
                self._socket.setsockopt(zmq.UNSUBSCRIBE, protocol.message_key(self._epoch, name))
        self._subscribed = {}

    def _end_run(self) -> None:
        if self.run is None:
            return
        for sock in self.run.sockets():
            self._poller.unregister(sock)
        self._lost_before += sum(tap.lost for tap in self.run.taps.values())
        self.run.close()
        self.run, self._keys = None, {}

    def close(self) -> None:
        """Ends the run here, and the connection."""
        self._end_run()
        self._socket.disable_monitor()
        self._monitor.close(linger=0)
        self._context.destroy(linger=0)


def _watch_connection(sock: zmq.Socket) -> None:
    """Lets the kernel find out that a server's host is gone.

    Answers to heartbeats lie unread behind a full queue: libzmq 4.3.5 would connect anew, and abort the process.
    """
    sock.setsockopt(zmq.TCP_KEEPALIVE, 1)
    sock.setsockopt(zmq.TCP_KEEPALIVE_IDLE, _PROBE_S)
    sock.setsockopt(zmq.TCP_KEEPALIVE_INTVL, _PROBE_S)
    sock.setsockopt(zmq.TCP_KEEPALIVE_CNT, _GONE_S // _PROBE_S)
    sock.setsockopt(zmq.TCP_MAXRT, 1000 * _GONE_S)  # of what was sent and is not acknowledged
