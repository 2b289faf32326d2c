"""Links between a program and a running graph: whole packets or none, and a side that goes is noticed at once."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from evis.bus.links import MOST_BYTES, Link, LinkLost, Listener, connect


@pytest.fixture
def pair(short: Path) -> Iterator[tuple[Link, Link]]:
    """The program's end, and the node's."""
    listener = Listener(short / "a.door")
    here = connect(short / "a.door")
    there = listener.accept()
    assert there is not None and listener.accept() is None
    yield here, there
    here.close()
    there.close()
    listener.close()


@pytest.fixture
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for a socket, whose path is limited."""
    return tmp_path_factory.mktemp("l")


def test_packets_come_whole_and_in_order(pair: tuple[Link, Link]) -> None:
    here, there = pair
    array = np.arange(12, dtype=np.float64)
    here.send([b"head", array.data.cast("B")])
    here.send([b""])
    assert there.receive() == [b"head", array.tobytes()]
    assert there.receive() == [b""] and there.receive() is None
    there.send([b"answer"])
    assert here.receive(10.0) == [b"answer"]
    assert there.peer == os.getpid()


@pytest.mark.parametrize("gone", [True, False])
def test_what_came_is_read_after_an_answer_that_could_not_be_sent(pair: tuple[Link, Link], gone: bool) -> None:
    """gone: the other side has closed its end; otherwise it reads nothing."""
    here, there = pair
    for said in (b"last", b"leave"):
        here.send([said])
    if gone:
        here.close()
    with pytest.raises(LinkLost):
        for _ in range(1 << 12):
            there.send([bytes(1 << 12)])
    assert [there.receive(10.0), there.receive(10.0)] == [[b"last"], [b"leave"]]
    with pytest.raises(LinkLost, match="closed"):
        there.receive(10.0)


def test_a_packet_larger_than_the_socket_comes_in_parts(pair: tuple[Link, Link]) -> None:
    here, _ = pair
    big = os.urandom(3_000_000)
    code = (
        "import sys; from pathlib import Path; from evis.bus.links import connect\n"
        "link = connect(Path(sys.argv[1])); link.send([bytes(3_000_000)], 60); link.receive(60)"
    )
    with pytest.raises(LinkLost, match="has read nothing for 0 s"):
        here.send([big])  # a node never waits for a program that does not read
    listener = Listener(Path(str(here._socket.getpeername())).with_name("b.door"))
    child = subprocess.Popen([sys.executable, "-c", code, str(listener.path)])
    try:
        link = None
        while link is None:
            link = listener.accept()
        assert link.receive(60.0) == [bytes(3_000_000)] and link.peer == child.pid
        child.send_signal(signal.SIGKILL)
        with pytest.raises(LinkLost):
            link.receive(60.0)
    finally:
        child.kill()
        child.wait()
        listener.close()


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (struct.pack("<I", 0), "a packet of 0 frames"),
        (struct.pack("<I", 9), "a packet of 9 frames"),
        (b"GET / HTTP/1.1", "frames"),
        (struct.pack("<II", 1, MOST_BYTES + 1), "the limit is"),
    ],
)
def test_what_is_no_packet_ends_the_link(pair: tuple[Link, Link], data: bytes, why: str) -> None:
    here, there = pair
    here._socket.sendall(data)
    with pytest.raises(LinkLost, match=why):
        there.receive(10.0)


def test_half_a_packet_holds_nobody_up(pair: tuple[Link, Link]) -> None:
    here, there = pair
    here._socket.sendall(struct.pack("<II", 1, 10) + b"half")
    assert there.receive() is None
    here._socket.sendall(b" is it")
    assert there.receive(10.0) == [b"half is it"]


def test_nobody_listens(tmp_path: Path) -> None:
    with pytest.raises(OSError):
        connect(tmp_path / "none.door")
