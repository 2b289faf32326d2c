"""The page's server against who has no token, no manners or another name: raw sockets, small numbers."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import re
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest
from synthetic_graph import make_node, make_plan

from evis.web import address, gate, notices
from nodes.visualizer import hub

LIMIT_S = 60.0
"""For all that is waited for: only what hangs takes it."""


class Site:
    """A node's page: where it is, and raw requests to it."""

    def __init__(self, node: Any, folder: Path) -> None:
        self.node = node
        self.url = json.loads((folder / "viewer.json").read_text())["url"]
        self.token = self.url.partition("?token=")[2]
        self.at = ("127.0.0.1", int(re.findall(r":(\d+)/", self.url)[0]))
        self.host = f"127.0.0.1:{self.at[1]}"

    def open(self, sent: bytes = b"") -> socket.socket:
        """A connection over which `sent` has gone."""
        connection = socket.create_connection(self.at, LIMIT_S)
        connection.sendall(sent)
        return connection

    def ask(self, path: str = "", *headers: str, method: str = "GET", body: bytes = b"", host: str = "") -> bytes:
        """The whole answer to a request, b"" where the connection is closed without one."""
        lines = [f"{method} /{path} HTTP/1.1", f"Host: {host or self.host}", "Connection: close", *headers, "", ""]
        with self.open() as connection:
            with contextlib.suppress(ConnectionError):  # it may be closed before all has gone
                connection.sendall("\r\n".join(lines).encode("utf-8", "surrogateescape") + body)
            return rest(connection)

    def page(self) -> bytes:
        """The page, as who has the token gets it."""
        return self.ask(f"?token={self.token}")

    def counted(self, name: str) -> int:
        """A counter of the node."""
        self.node.idle()
        return self.node.runtime.counted[name]


def send(connection: socket.socket, data: bytes) -> None:
    """Sends all of it and no more. Who refuses it may have cut the connection by then: a reset one is not connected."""
    try:
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
    except OSError as error:
        if not isinstance(error, ConnectionError) and error.errno != errno.ENOTCONN:
            raise


def rest(connection: socket.socket) -> bytes:
    """What comes until the other end closes."""
    parts = []
    with contextlib.suppress(ConnectionError):
        while part := connection.recv(1 << 16):
            parts.append(part)
    return b"".join(parts)


@pytest.fixture
def make_site(tmp_path: Path) -> Iterator[Callable[..., Site]]:
    """Make a node with its page."""
    made = []

    def make(**params: Any) -> Site:
        node = make_node(make_plan(tmp_path), **params)
        made.append(node)
        return Site(node, tmp_path)

    yield make
    for node in made:
        node.close()


@pytest.fixture
def site(make_site: Callable[..., Site]) -> Site:
    return make_site()


def status(answer: bytes) -> bytes:
    """The number of an answer; b"" where there is none."""
    return answer[9:12]


@pytest.mark.parametrize(
    "head", [b"", b"GET / HTTP/1.1\r\nHost: localhost\r\nX-A", b"\r\n\r\n", b"\x16\x03\x01\x02\x00"]
)
def test_half_open_requests_are_closed(
    make_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch, head: bytes
) -> None:
    monkeypatch.setattr(gate, "HEAD_S", 0.2)
    site = make_site()
    with site.open(head) as connection:
        assert status(rest(connection)) in (b"", b"400")
    monkeypatch.setattr(gate, "HEAD_S", 1e6)  # a busy machine may take longer over a whole one
    assert status(site.page()) == b"200"


def test_a_byte_at_a_time_does_not_prolong_it(make_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch) -> None:
    """Slowloris: the time runs from the opening, not from the last byte; a body without end is no way round it."""
    monkeypatch.setattr(gate, "HEAD_S", 0.3)
    site = make_site()
    post = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000000000\r\n\r\n"
    for start in (b"GET / HTTP/1.1\r\n", post):
        with site.open(start) as connection:
            connection.settimeout(0.02)
            with contextlib.suppress(ConnectionError):
                for _ in range(3000):
                    connection.send(b"x")
                    with contextlib.suppress(TimeoutError):
                        if not connection.recv(1 << 16):
                            break
                else:
                    pytest.fail("it was never closed")
    assert site.counted(gate.DROPPED) == 2


def test_strangers_keep_no_viewer_out(make_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch) -> None:
    """However many hold a connection: the oldest go, a viewer gets the page, and one who looks goes on looking."""
    monkeypatch.setattr(gate, "STRANGERS", 16)
    monkeypatch.setattr(gate, "HEAD_S", 1e6)
    monkeypatch.setattr(gate, "GRACE_S", 0.1)
    site = make_site()

    async def look() -> None:
        async with aiohttp.ClientSession() as http:
            ws = await http.ws_connect(f"http://{site.host}/{site.token}/ws")
            await ws.receive(LIMIT_S)
            held = [await asyncio.to_thread(site.open, b"GET / HTTP/1.1\r\nX: ") for _ in range(60)]
            for connection in held[:44]:
                assert await asyncio.to_thread(rest, connection) == b""
            assert status(await asyncio.to_thread(site.page)) == b"200"
            assert len(site.node._server.gate.strangers) <= 16
            await ws.send_json({"op": "nonsense"})
            while (message := await ws.receive(LIMIT_S)).type is not aiohttp.WSMsgType.TEXT:
                pass
            assert "unknown op" in message.json()["text"]
            for connection in held:
                connection.close()

    asyncio.run(look())
    assert site.counted(gate.DROPPED) >= 44


def test_connections_with_the_token_have_a_limit_too(
    make_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gate, "FRIENDS", 2)
    site = make_site()
    keep = f"GET /?token={site.token} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
    with site.open(keep) as one, site.open(keep) as two:
        assert one.recv(12) == two.recv(12) == b"HTTP/1.1 200"
        assert b"too many connections are open" in site.page()
    for _ in range(1000):  # until the two have been seen to go
        if (answer := status(site.page())) == b"200":
            break
    assert answer == b"200"


@pytest.mark.parametrize(
    "host",
    [
        "localhost",
        "LocalHost:1",
        "127.0.0.1",
        "127.0.0.1:9999",
        "[::1]:80",
        "[0:0::1]",
        "evis.example:80",
        "Proxy.Example",
    ],
)
def test_names_of_the_page(make_site: Callable[..., Site], host: str) -> None:
    """Any port: an ssh -L has its own."""
    site = make_site(names=["evis.example", "proxy.example"])
    assert status(site.ask(f"?token={site.token}", host=host)) == b"200"


@pytest.mark.parametrize(
    "host",
    ["example.org", "localhost.example.org", "evil@localhost", "localhost:80@evil", "127.0.0.1.evil", "127.0.0.2",
     "[::2]", "localhost, evil", "2130706433", "localhost:80:80", "x" * 4000, "\xff", "["],
)  # fmt: skip
def test_other_names_get_nothing(make_site: Callable[..., Site], host: str) -> None:
    """A foreign site's name that leads here shows nothing, not even to who has the token."""
    site = make_site()
    for path in (f"?token={site.token}", f"{site.token}/main.js", f"{site.token}/ws"):
        answer = site.ask(path, host=host)
        assert status(answer) in (b"400", b"403") and site.token.encode() not in answer


def test_one_name_is_needed(site: Site) -> None:
    """Neither none, as the oldest HTTP allows, nor two of which somebody else may take the other."""
    assert status(site.ask(f"?token={site.token}", "Host: localhost")) in (b"400", b"403")
    with site.open(f"GET /?token={site.token} HTTP/1.0\r\n\r\n".encode()) as connection:
        assert status(rest(connection)) == b"403"


def test_the_address_that_is_listened_on_is_a_name() -> None:
    with socket.socket() as listener:
        listener.bind(("127.0.0.3", 0))
        names = address.names_of(listener, ["My.Host"])
    assert address.is_served(["127.0.0.3:80"], names, "") and address.is_served(["my.host"], names, "")
    assert address.is_served(["10.1.2.3:80"], names, "::ffff:10.1.2.3")  # listening on every address of the machine
    assert not address.is_served(["10.1.2.4:80"], names, "10.1.2.3") and not address.is_served([], names, "10.1.2.3")


def test_junk_is_refused_counted_and_not_logged(site: Site, capfd: pytest.CaptureFixture[str]) -> None:
    """One line however much of it there is, and nothing on stderr, where the log of the process is."""
    rng = np.random.default_rng(7)
    junk = [
        b"\x16\x03\x01\x02\x00\x01\x00", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"\0" * 100,
        b"G" * 20000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"A: b\r\n" * 5000 + b"\r\n",
        b"GET http://[ HTTP/1.1\r\nHost: localhost\r\n\r\n", b"GET /\xff\xfe/ws HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"CONNECT a:1 HTTP/1.1\r\nHost: localhost\r\n\r\n", b"OPTIONS * HTTP/1.1\r\nHost: localhost\r\n\r\n",
        *(rng.bytes(300) + b"\r\n\r\n" for _ in range(20)),
    ]  # fmt: skip
    for data in junk * 3:
        with site.open() as connection:
            send(connection, data)
            assert rest(connection)[:12] in (b"", b"HTTP/1.1 400", b"HTTP/1.1 403", b"HTTP/1.0 403", b"HTTP/1.0 400"), (
                data
            )
    assert status(site.page()) == b"200"
    assert site.counted(gate.REFUSED) > len(junk)
    said = [text for _, text in site.node.runtime.said]
    assert said == ["requests come that are no HTTP; they are refused and counted"]
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("origin", ["http://[", "null", "http://example.org", "//", "http://127.0.0.1:1", "\udcff"])
def test_odd_origins_are_refused(site: Site, origin: str) -> None:
    answer = site.ask(f"{site.token}/ws", f"Origin: {origin}", "Upgrade: websocket", "Sec-WebSocket-Version: 13")
    assert status(answer) in (b"400", b"403")
    assert not site.node.runtime.said


def test_bodies_and_long_heads_are_not_taken(site: Site) -> None:
    """Without the token nobody sends much, whatever he says that he sends."""
    much = b"x" * (8 << 20)
    for headers in ((f"Content-Length: {len(much)}",), ("Transfer-Encoding: chunked",), ("Expect: 100-continue",)):
        body = much if "chunked" not in headers[0] else b"800000\r\n" + much + b"\r\n0\r\n\r\n"
        assert status(site.ask("", *headers, method="POST", body=body)) in (b"", b"403", b"100")
    assert status(site.ask("", *(f"X-{i}: {'y' * 4000}" for i in range(100)))) in (b"", b"400")
    assert status(site.page()) == b"200"


def upgrade(site: Site) -> socket.socket:
    """A WebSocket of the page without a library that would hinder nonsense; its greeting is left in it."""
    head = [f"GET /{site.token}/ws HTTP/1.1", f"Host: {site.host}", "Upgrade: websocket", "Connection: Upgrade"]
    head += ["Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "", ""]
    connection = site.open("\r\n".join(head).encode())
    assert connection.recv(12) == b"HTTP/1.1 101"
    return connection


def frame(payload: bytes, opcode: int = 1, fin: int = 0x80, length: int | None = None) -> bytes:
    """A masked frame; `length` is what it says that it has."""
    n = len(payload) if length is None else length
    return struct.pack(">BBQI", fin | opcode, 0xFF, n, 0) + payload


CLOSING = {
    "as long as an int": frame(b"x", length=1 << 62),
    "too long": frame(b"x" * 70000),
    "too long in parts": frame(b"x" * 40000, fin=0) + frame(b"x" * 40000, opcode=0),
    "a part of nothing": frame(b"x", opcode=0),
    "no opcode": frame(b"x", opcode=5),
    "no UTF-8": frame(b"\xff\xff"),
    "reserved bits": frame(b"x", fin=0xF0),
    "a long ping": frame(b"x" * 200, opcode=9),
    "a wrong close": frame(b"\0\1", opcode=8),
    "zeros": b"\0" * 1000,
    "noise": np.random.default_rng(3).bytes(5000),
}  # fmt: skip


@pytest.mark.parametrize("what", CLOSING)
def test_frames_that_are_none_close_that_connection(site: Site, what: str) -> None:
    """And no other; nothing is said about it."""
    other = upgrade(site)
    with upgrade(site) as connection:
        send(connection, CLOSING[what])
        rest(connection)
    other.sendall(frame(b'{"op": "nonsense"}'))
    seen = b""
    while b"unknown op 'nonsense'" not in seen:
        part = other.recv(1 << 16)
        assert part, seen
        seen += part
    other.close()
    site.node.idle()
    assert not site.node.runtime.said


ANSWERED = {
    "[" * 60000: "nested too deeply",
    '{"a":' * 13000: "nested too deeply",
    '{"op": "panels", "panels": ' + "[" * 900 + "]" * 900 + "}": "a panel must be a map",
    '{"op": ' + "[" * 900 + "]" * 900 + "}": "unknown op",
    "1" * 60000: "",
    "[]": "a message must be a map",
    "5": "a message must be a map",
    '{"op": null}': "unknown op",
    '{"op": "' + "x" * 60000 + '"}': "unknown op",
    '{"op": "panels"}': "panels must be a list",
    '{"op": "panels", "panels": [5]}': "a panel must be a map",
    '{"op": "panels", "panels": [{}]}': "a panel needs 'id'",
    '{"op": "panels", "panels": [{"id": [[]], "topic": "/cam0/events", "view": "events"}]}': "a panel needs 'id'",
    '{"op": "panels", "panels": [{"id": "' + "x" * 300 + '", "topic": "a", "view": "b"}]}': "the most is",
    '{"op": "panels", "panels": [{"id": "a", "topic": "\\ud800", "view": "b"}]}': "no topic",
    '{"op": "panels", "panels": [{"id": "a", "topic": "/cam0/events", "view": "events", "env": 1e400}]}': "environment",
    '{"op": "panels", "panels": [{"id": "a", "topic": "/cam0/events", "view": "events", "env": true}]}': "environment",
}


def test_every_nonsense_is_answered(site: Site) -> None:
    """With a short text, on a connection that stays; nothing is traced."""

    async def look() -> None:
        async with aiohttp.ClientSession() as http:
            ws = await http.ws_connect(f"http://{site.host}/{site.token}/ws")
            await ws.receive(LIMIT_S)

            async def answer() -> str:
                while (message := await ws.receive(LIMIT_S)).type is not aiohttp.WSMsgType.TEXT:
                    assert message.type is aiohttp.WSMsgType.BINARY, message
                return message.json()["text"]

            for text, expected in ANSWERED.items():
                await ws.send_str(text)
                said = await answer()
                assert expected in said and len(said) <= 200, text[:100]
            await ws.send_bytes(b"\0\1\2")
            assert await answer() == "messages are JSON text"

    asyncio.run(look())
    assert site.counted(gate.REFUSED) == len(ANSWERED) + 1
    assert not site.node.runtime.said


def test_all_pages_together_have_a_limit_of_panels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each different panel holds a picture; the same panel on two pages counts once, and closing makes room."""
    monkeypatch.setattr(hub, "MAX_VIEWS", 3)
    made = hub.Hub(make_plan(tmp_path), 80)
    keys = [hub.PanelKey("/cam0/events", "events", env) for env in range(5)]
    for client in "ab":
        made.join(client, lambda: None)
        made.show(client, frozenset(keys[:2]))
    with pytest.raises(ValueError, match="4 different panels on all pages, the most is 3"):
        made.show("b", frozenset(keys[2:4]))
    made.leave("a")
    made.show("b", frozenset(keys[2:5]))
    assert made.view(keys[4]) is not None and made.view(keys[0]) is None


def test_what_the_node_says_has_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = hub.Hub(make_plan(tmp_path), 80)
    for k in range(1000):
        made.report("the same")
        made.report(f"text {k}")
    assert made.reports() == ["the same", *(f"text {k}" for k in range(notices.REPORTS - 1))]
    assert made.counts() == {"warnings_left_out": 1000 - notices.REPORTS + 1}
    monkeypatch.setattr(notices, "REPORTS_S", 0.0)
    made.report("the same")
    assert made.reports() == ["the same"]


def test_a_fault_of_the_server_is_one_short_line(site: Site, monkeypatch: pytest.MonkeyPatch, capfd: Any) -> None:
    """No traceback, no line breaks, no control characters."""

    def broken(*_: Any) -> None:
        raise RuntimeError("first\nsecond \x1b[31m" + "x" * 1000)

    monkeypatch.setattr("evis.web.gate.admit", broken)
    assert status(site.page()) == b"500"
    site.node.idle()
    ((level, text),) = site.node.runtime.said
    assert level == "warning" and "RuntimeError: first second" in text and len(text) <= 200 and text.isprintable()
    assert capfd.readouterr().err == ""


def test_evis_view_serves_by_the_same_rules(tmp_path: Path) -> None:
    """The page of a file: the token, the name, and nothing of it but the address said."""
    t = np.arange(2000, dtype=np.int64) * 5_000_000
    zeros = np.zeros(2000, np.uint16)
    np.savez(tmp_path / "a.npz", t=t, x=zeros, y=zeros, p=zeros.astype(np.uint8))
    process = subprocess.Popen(
        [sys.executable, "-m", "evis", "view", str(tmp_path / "a.npz"), "--port", "0", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    try:
        url = json.loads(process.stdout.readline())["url"]
        page, _, token = url.partition("?token=")
        host = page.removeprefix("http://").strip("/")
        answers = {}
        for name in (host, "evil.example"):
            with socket.create_connection(("127.0.0.1", int(host.partition(":")[2])), LIMIT_S) as connection:
                connection.sendall(
                    f"GET /?token={token} HTTP/1.1\r\nHost: {name}\r\nConnection: close\r\n\r\n".encode()
                )
                answers[name] = status(rest(connection))
        assert answers == {host: b"200", "evil.example": b"403"}
    finally:
        process.terminate()
        _, err = process.communicate(timeout=LIMIT_S)
    assert token not in err
