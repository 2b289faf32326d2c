"""Peers that should not be there, or say what they should not; servers that go and come back."""

from __future__ import annotations

import dataclasses
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import msgpack
import numpy as np
import pytest
import zmq
from two_hosts import EVENTS, HERE, Hosts, packet, pair

from evis.bus import BusError
from evis.config.secret import HIDDEN
from evis.remote import follower as follower_module
from evis.remote.keys import KeyPair
from evis.remote.protocol import Hello, ProtocolError, check_address, message_key, pack_mark
from evis.remote.server import Server
from evis.runtime.plan import Plan
from msgs.codec import encode

SECRET = b"what only the two hosts may read"


def subscriber(context: zmq.Context, address: str, key: KeyPair | None = None, server: bytes = b"") -> zmq.Socket:
    """One that subscribes to everything; without a key it speaks as if there were none."""
    sock = context.socket(zmq.SUB)
    sock.linger = 0
    if key is not None:
        sock.curve_serverkey, sock.curve_publickey, sock.curve_secretkey = server, key.public, key.secret
    sock.subscribe(b"")
    sock.connect(address)
    return sock


@contextmanager
def proxied(port: int) -> Iterator[tuple[int, bytearray]]:
    """A port that leads to another, and what went through it in either direction."""
    seen = bytearray()
    listener = socket.create_server(("127.0.0.1", 0))

    def copy(source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(1 << 16):
                seen.extend(data)
                sink.sendall(data)
        except OSError:
            pass

    def serve() -> None:
        client, _ = listener.accept()
        server = socket.create_connection(("127.0.0.1", port))
        threading.Thread(target=copy, args=(server, client), daemon=True).start()
        copy(client, server)

    threading.Thread(target=serve, daemon=True).start()
    with closing(listener):
        yield listener.getsockname()[1], seen


def port_of(server: Server) -> int:
    return int(server.address.rpartition(":")[2])


def test_an_eavesdropper_gets_nothing(hosts: Hosts) -> None:
    """Who has no key, or an unknown one, no message; who reads the bytes on the line, nothing that is in one."""
    with zmq.Context() as context, proxied(port_of(hosts.server)) as (port, seen):
        strangers = [
            subscriber(context, hosts.server.address),
            subscriber(context, hosts.server.address, pair(), hosts.server_key.public),
        ]
        hosts.follow(address=f"tcp://127.0.0.1:{port}")
        hosts.until(lambda: hosts.follower and hosts.follower.run)
        reader = hosts.reader(EVENTS)
        text = np.frombuffer(SECRET * 20, np.int64)
        ones = np.ones(len(text), np.uint16)
        message = dataclasses.replace(
            packet(0), env_offsets=np.array([0, len(text)]), t=text, x=ones, y=ones, p=ones.astype(np.uint8)
        )
        hosts.graph.publishers[EVENTS].send(message)
        assert hosts.until(lambda: reader.receive(5)).t.tobytes() == SECRET * 20
        for _ in range(50):
            hosts.turn()
        assert len(seen) > 20 * len(SECRET) and SECRET not in seen and EVENTS.encode() not in seen
        assert not any(sock.poll(0) for sock in strangers)
        refused = [name for name, admitted in hosts.server._followers.came if not admitted]
        assert len(refused) == 1
        for sock in strangers:
            sock.close()


def test_all_who_knock_at_once_are_counted(hosts: Hosts) -> None:
    """Also more than lines are kept of; of each that is let in, and of ten others, there is a line."""
    told: list[str] = []
    strangers = 3000
    for k in range(strangers):
        assert not hosts.server._followers.callback("", b"%040d" % k)
    again = iter([True, False])
    hosts.server.run(lambda: next(again), told.append)
    assert hosts.server.counters["refused"] == strangers and hosts.server.counters["admitted"] == 0
    assert len(told) == 10


def failure(hosts: Hosts, **changed: object) -> str:
    """What a follower is told that cannot connect; the server goes on in a thread."""
    done = threading.Event()

    def serve() -> None:
        while not done.is_set():
            hosts.server.serve(10)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        with pytest.raises(ConnectionError) as error:
            hosts.follow(**changed).connect(lambda: False)
    finally:
        done.set()
        thread.join()
    return str(error.value)


def test_keys_that_are_not_known_are_told(hosts: Hosts) -> None:
    assert "does not know this key" in failure(hosts, key=pair())
    assert hosts.follower is not None
    hosts.follower.close()
    assert "no `evis remote serve` with the key of --server" in failure(hosts, server=pair().public)


def test_who_is_no_server_is_told(hosts: Hosts, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody, and somebody who speaks something else, at once much of it."""
    monkeypatch.setattr(follower_module, "FIRST_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert "nothing answers" in failure(hosts, address=f"tcp://127.0.0.1:{port}")
    assert hosts.follower is not None
    hosts.follower.close()
    with socket.create_server(("127.0.0.1", 0)) as other:

        def talk() -> None:
            try:
                while True:
                    client, _ = other.accept()
                    client.sendall(b"\xff" * 1_000_000)
                    client.close()
            except OSError:
                pass

        threading.Thread(target=talk, daemon=True).start()
        assert "what answers" in failure(hosts, address=f"tcp://127.0.0.1:{other.getsockname()[1]}")
        other.shutdown(socket.SHUT_RDWR)


def test_what_strangers_send_does_not_disturb(hosts: Hosts) -> None:
    """Bytes that are no ZeroMQ, with huge lengths; and of a peer with a key, what is no subscription."""
    hosts.connected()
    reader = hosts.reader(EVENTS)
    greeting = b"\xff" + bytes(8) + b"\x7f" + b"\x03\x01" + b"CURVE".ljust(20, b"\0") + bytes(32)
    with zmq.Context() as context:
        for data in (
            b"GET / HTTP/1.1\r\n\r\n",
            bytes(1000),
            greeting + b"\x06" + struct.pack(">Q", 1 << 62) + bytes(99),
        ):
            with socket.create_connection(("127.0.0.1", port_of(hosts.server))) as sock:
                sock.sendall(data)
                for _ in range(3):
                    hosts.turn()
        peer = context.socket(zmq.XSUB)
        peer.linger = 0
        key = hosts.follower_key
        peer.curve_serverkey, peer.curve_publickey, peer.curve_secretkey = (
            hosts.server_key.public,
            key.public,
            key.secret,
        )
        peer.connect(hosts.server.address)
        for frame in (b"\x07no", b"\x01" + b"x" * 1000, b"\x01*", b"\x00" + b"never"):
            peer.send(frame)
        peer.send_multipart([b"\x01a", b"\x01b"])
        hosts.until(lambda: hosts.server.counters["rejected"])
        peer.send(b"\x07" + b"y" * (1 << 20))
        for _ in range(20):
            hosts.turn()
        peer.close()
    hosts.graph.publishers[EVENTS].send(packet(5))
    assert hosts.until(lambda: reader.receive(5)).t[0] == 5


class FalseServer:
    """Has the right key, and says what a test has it say."""

    def __init__(self, key: KeyPair) -> None:
        self._context = zmq.Context()
        self.socket = self._context.socket(zmq.XPUB)
        self.socket.linger = 0
        self.socket.curve_server = True
        self.socket.curve_publickey, self.socket.curve_secretkey = key.public, key.secret
        self.socket.bind(HERE)
        self.address = self.socket.getsockopt_string(zmq.LAST_ENDPOINT)

    def greet(self, hosts: Hosts, hello: bytes) -> None:
        """Answers the greeting of a follower."""
        assert hosts.follower is not None
        while not (key := self.socket.recv()).startswith(b"\1!"):
            pass
        self.socket.send_multipart([key[1:], hello])

    def close(self) -> None:
        self._context.destroy(linger=0)


@pytest.fixture
def liar(hosts: Hosts) -> Iterator[FalseServer]:
    server = FalseServer(hosts.server_key)
    yield server
    server.close()


def hello_of(hosts: Hosts) -> dict[str, object]:
    return msgpack.unpackb(Hello(b"12345678", hosts.graph.plan).pack())


def test_no_secret_of_the_graph_is_told(hosts: Hosts) -> None:
    """Whoever makes the server: what finds a running graph takes them out as well."""
    password = "correct horse battery"
    given = {"args": {"password": password}, "launch_text": f"to: http://{password}@cam", "secrets": [password]}
    plan = dataclasses.replace(hosts.graph.plan, **given)
    told = Hello(b"12345678", plan).pack()
    assert password.encode() not in told and Hello.unpack(told).plan.args == {"password": HIDDEN}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"remote": 2}, "speaks version 2, this side 1: run the same release"),
        ({"types": {EVENTS: "EventPacket v7"}}, "run the same release on both sides"),
        ({"plan": "[1]"}, "cannot be read"),
        ({"plan": "[" * 100_000}, "cannot be read"),
        ({"plan": '{"nodes": 3}'}, "cannot be read"),
        ({"epoch": 3}, "no description of a graph"),
    ],
)
def test_a_hello_that_is_not_understood(hosts: Hosts, liar: FalseServer, change: dict[str, object], told: str) -> None:
    follower = hosts.follow(address=liar.address)
    liar.greet(hosts, msgpack.packb({**hello_of(hosts), **change}))
    with pytest.raises(ProtocolError, match=told) as error:
        hosts.until(lambda: follower.run, graph=False, server=False)
    assert len(str(error.value)) < 400 and "\n" not in str(error.value)
    assert not list((hosts.far / "evis").glob("*"))


def test_messages_that_are_none_are_counted(hosts: Hosts, liar: FalseServer) -> None:
    """As on the bus: nothing of them is believed, and what is right among them comes."""
    follower = hosts.follow(address=liar.address)
    liar.greet(hosts, msgpack.packb(hello_of(hosts)))
    hosts.until(lambda: follower.run, graph=False, server=False)
    assert follower.run is not None
    key, mark, right = message_key(b"12345678", EVENTS), pack_mark(0, True), encode(packet(0))
    header = msgpack.unpackb(right[0])
    huge = msgpack.packb({**header, "arrays": [["t", "int64", [1 << 47]], *header["arrays"][1:]]})
    slot = msgpack.packb({**header, "extra": {"slot": [1, 2, 3]}})
    wrong = [
        [key], [key, mark], [key, b"", *right], [key, mark, b"\xc1"], [key, mark, huge, *right[1:]],
        [key, mark, *right[:-1]], [key, mark, slot, *right[1:]], [key, mark, b"\x91" * 100_000],
        [b"12345678/x\0", mark],
    ]  # fmt: skip
    tap = follower.run.taps[EVENTS]
    tap.sender.listeners = 1
    follower._socket.setsockopt(zmq.SUBSCRIBE, b"12345678")
    hosts.until(lambda: liar.socket.poll(0) and liar.socket.recv() == b"\x0112345678", graph=False, server=False)
    for frames in [*wrong, [key, mark, *right]]:
        liar.socket.send_multipart(frames)
    hosts.until(lambda: follower.counters["messages"], graph=False, server=False)
    assert follower.counters["messages"] == 1 and follower.counters["rejected"] == len(wrong)
    assert tap.sender.sent == 1


def test_an_address_that_is_taken(hosts: Hosts) -> None:
    with pytest.raises(BusError, match="Address already in use; it must be a numeric address of this host"):
        Server(Plan("a", "b", ""), hosts.server.address, hosts.server_key, {})


@pytest.mark.parametrize(
    "address", ["localhost:1", "tcp://a:99999", "tcp://:1", "ipc:///tmp/a", "tcp://a:b", "tcp://a"]
)
def test_what_is_no_address(address: str) -> None:
    with pytest.raises(ValueError, match="is no address"):
        check_address(address, bound=True)


@pytest.mark.parametrize("address", ["tcp://*:1", "tcp://a:*", "tcp://a:0"])
def test_a_follower_needs_to_know_where(address: str) -> None:
    assert check_address(address, bound=True) == address
    with pytest.raises(ValueError):
        check_address(address, bound=False)


def test_a_server_that_is_started_again_goes_on_with_the_run(hosts: Hosts) -> None:
    """Its readers stay, and what was sent meanwhile is counted as lost."""
    follower = hosts.connected()
    reader = hosts.reader(EVENTS)
    events = hosts.graph.publishers[EVENTS]
    events.send(packet(0))
    assert hosts.until(lambda: reader.receive(5)).header.seq == 0
    address = hosts.server.address
    hosts.server.close()
    hosts.until(lambda: follower.counters["breaks"], server=False)
    # The tap of the server that is gone may still be there for a moment.
    hosts.until(lambda: not events.tapped_by_eager(), server=False)
    for k in range(1, 5):
        events.send(packet(k))
    hosts.serve(address)
    hosts.until(events.tapped_by_eager)
    events.send(packet(5))
    assert hosts.until(lambda: reader.receive(5)).header.seq == 5
    assert (follower.counters["lost"], reader.lost) == (4, 4)
    assert any("is broken" in line for line in hosts.said) and any("again, after" in line for line in hosts.said)


def test_a_publisher_that_is_started_again_is_counted_from_0(hosts: Hosts) -> None:
    """What it sent before it was read anew is lost, here and on the other host, whatever came of the one before."""
    follower = hosts.connected()
    reader = hosts.reader(EVENTS)
    events = hosts.graph.publishers[EVENTS]
    for k in (0, 1):
        events.send(packet(k))
    events.miss(8)
    events.send(packet(10))
    for k in (0, 1, 10):
        assert hosts.until(lambda: reader.receive(5)).header.seq == k
    assert (follower.counters["lost"], reader.lost) == (8, 8)
    hosts.graph.start_again(EVENTS)
    hosts.until(hosts.graph.publishers[EVENTS].tapped_by_eager)
    hosts.graph.publishers[EVENTS].miss(3)
    hosts.graph.publishers[EVENTS].send(packet(3))
    assert hosts.until(lambda: reader.receive(5)).header.seq == 3
    assert (follower.counters["lost"], reader.lost) == (11, 11)


def test_another_run_does_not_mix_with_the_last(hosts: Hosts) -> None:
    """Its messages come to a run of their own; who reads the old one is told that it has ended."""
    follower = hosts.connected()
    reader = hosts.reader(EVENTS)
    assert follower.run is not None
    before = Path(follower.run.plan.directory)
    hosts.graph.publishers[EVENTS].send(packet(0))
    hosts.until(lambda: reader.receive(5))
    address = hosts.server.address
    hosts.server.close()
    hosts.graph.close()
    hosts.start_graph("second")
    hosts._monkeypatch.setenv("XDG_RUNTIME_DIR", str(hosts.far))
    hosts.serve(address)
    hosts.until(lambda: follower.run is not None and follower.run.plan.run_id == "second")
    assert hosts.until(lambda: reader.receive(5)).__class__.__name__ == "End"
    assert not before.exists()
    newer = hosts.reader(EVENTS)
    hosts.graph.publishers[EVENTS].send(packet(7))
    assert hosts.until(lambda: newer.receive(0)).t[0] == 7
    assert reader.receive(0) is None and follower.counters["lost"] == 0


def test_a_run_of_this_host_is_not_followed(hosts: Hosts) -> None:
    """It would be there twice under one name."""
    hosts.far = hosts.near
    follower = hosts.follow()
    with pytest.raises(ProtocolError, match="is on this host already"):
        hosts.until(lambda: follower.run)
