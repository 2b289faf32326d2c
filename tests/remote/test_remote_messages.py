"""What comes to another host: the same bytes, the last of what is latched, and a count of all that is lost."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import zmq
from two_hosts import EVENTS, IMAGE, INFO, Hosts, info, packet

from evis.bus import END, endpoints_for
from evis.client.running import choose
from msgs.camera import Image
from msgs.codec import encode
from msgs.header import Header


def raw_tap(context: zmq.Context, directory: str) -> zmq.Socket:
    """A tap as docs/wire.md has it, without anything of evis: every message, byte by byte."""
    sock = context.socket(zmq.SUB)
    sock.connect(endpoints_for(directory, EVENTS).tap)
    sock.setsockopt(zmq.SUBSCRIBE, b"*")
    sock.setsockopt(zmq.SUBSCRIBE, EVENTS.encode())
    return sock


def test_bytes_there_are_the_bytes_here(hosts: Hosts) -> None:
    follower = hosts.connected()
    assert follower.run is not None
    context = zmq.Context()
    here, there = (raw_tap(context, plan.directory) for plan in (hosts.graph.plan, follower.run.plan))
    hosts.until(lambda: hosts.graph.publishers[EVENTS]._tap.eager == 2)
    came: tuple[list[list[bytes]], list[list[bytes]]] = [], []
    sizes = [0, 1, 7, 5000, 200_000]
    for k, size in enumerate(sizes):
        hosts.graph.publishers[EVENTS].send(packet(k, size))
        for sock, messages in zip((here, there), came):
            hosts.until(lambda sock=sock: sock.poll(0))
            messages.append(sock.recv_multipart())
    context.destroy(linger=0)
    assert came[0] == came[1]
    assert [sum(map(len, message[2:])) for message in came[1]] == [16 + 13 * size for size in sizes]
    assert follower.counters["lost"] == 0 and follower.counters["messages"] == len(sizes) + 1  # and the camera's info


def test_who_comes_late_gets_the_last_of_what_is_latched(hosts: Hosts) -> None:
    """On the other host, however often, long after the graph has sent it; and a second host that comes later."""
    hosts.connected()
    for _ in range(2):
        reader = hosts.reader(INFO)
        message = hosts.until(lambda reader=reader: reader.receive(5))
        assert encode(message) == encode(info())
        reader.close()
        for _ in range(3):
            hosts.turn()
    first, hosts.follower = hosts.follower, None
    assert first is not None
    first.close()
    hosts.connected()
    last = hosts.reader(INFO)
    assert encode(hosts.until(lambda: last.receive(5))) == encode(info())


def test_what_nobody_reads_there_is_not_read_here(hosts: Hosts) -> None:
    hosts.connected()
    events = hosts.graph.publishers[EVENTS]
    for _ in range(3):
        hosts.turn()
    assert not events.wanted()
    viewer = hosts.reader(EVENTS, every=False)
    assert events.wanted() and not events.tapped_by_eager()
    program = hosts.reader(EVENTS)
    program.close()
    hosts.until(lambda: not events.tapped_by_eager() and events.wanted())
    viewer.close()
    hosts.until(lambda: not events.wanted())


def test_a_viewer_there_has_images_of_each_environment(hosts: Hosts) -> None:
    """As many of the last one as of the first, as on the host of the graph."""
    hosts.connected()
    viewer = hosts.reader(IMAGE, every=False)
    came: Counter[int] = Counter()

    def take() -> int:
        while (message := viewer.receive(0)) is not None:
            assert isinstance(message, Image) and (message.data == message.env).all()
            came[message.env] += 1
        return min(came[env] for env in range(4))

    stamps = iter(range(10_000))

    def burst() -> int:
        stamp = next(stamps)
        for env in range(4):
            pixels = np.full((6, 8, 1), env, np.uint8)
            hosts.graph.publishers[IMAGE].send(Image(Header(stamp), pixels, "mono8", env=env, envs=4))
        return take()

    hosts.until(lambda: burst() >= 10)
    assert max(came.values()) <= min(came.values()) + 4  # what is under way, at either limit


@pytest.mark.parametrize("stuck", ["server", "follower"])
def test_all_that_was_sent_has_come_or_is_counted(hosts: Hosts, stuck: str) -> None:
    """Between graph and server, and between server and follower, whichever stood still meanwhile."""
    follower = hosts.connected()
    hosts.reader(EVENTS)
    events = hosts.graph.publishers[EVENTS]
    events.send(packet(0))
    hosts.until(lambda: follower.counters["messages"] == 2)  # with the camera's info
    for k in range(1, 1001):
        events.send(packet(k, 20_000))
        hosts.turn(server=stuck != "server", follower=False)
    for _ in range(50):
        hosts.turn()
    events.send(packet(1001))  # what is lost shows with the next one that comes
    hosts.until(lambda: follower.counters["messages"] - 1 + follower.counters["lost"] == 1002)
    assert follower.counters["lost"] > 500
    assert follower.counters["messages"] > 10


def test_a_follower_that_does_not_read_holds_up_nobody(hosts: Hosts) -> None:
    """It holds a queue of messages, and no more: another follower gets every one of them."""
    stuck = hosts.connected()
    hosts.reader(EVENTS)
    hosts.follower = None
    follower = hosts.follow()
    assert stuck.run is not None
    # The first one's run is on this host already, so the second one waits on a third.
    hosts._monkeypatch.setenv("XDG_RUNTIME_DIR", str(hosts.near / "third"))
    (hosts.near / "third").mkdir(mode=0o700)
    hosts.until(lambda: follower.run)
    reader = hosts.reader(EVENTS)
    hosts.until(lambda: hosts.server._eager[EVENTS] == 2)
    count, got = 2000, 0  # more than queues and the system's buffers hold
    for first in range(0, count, 8):
        for k in range(first, first + 8):
            hosts.graph.publishers[EVENTS].send(packet(k, 2000))
        for k in range(first, first + 8):
            got += hosts.until(lambda: reader.receive(5)).t[0] == k
    assert got == count and follower.counters["lost"] == 0
    hosts.follower = stuck
    for _ in range(20):
        hosts.turn()
    hosts.graph.publishers[EVENTS].send(packet(count))
    infos = 2  # its own, and the one that came when the other follower asked for it
    hosts.until(lambda: stuck.counters["messages"] - infos + stuck.counters["lost"] == count + 1)
    assert stuck.counters["lost"] > count // 4
    hosts.follower = follower
    stuck.close()


def test_the_end_of_the_graph_is_the_end_there(hosts: Hosts) -> None:
    follower = hosts.connected()
    reader = hosts.reader(EVENTS)
    assert choose("first")[0].remote == hosts.server.address
    hosts.graph.publishers[EVENTS].send(packet(0))
    hosts.graph.publishers[EVENTS].finish(0)
    hosts.until(lambda: hosts.server.counters["sent"] >= 2)
    hosts.server.end()
    hosts.until(lambda: follower.ended, graph=False)
    directory = Path(follower.run.plan.directory) if follower.run is not None else Path()
    assert directory.is_dir()
    follower.close()
    assert not directory.exists()
    hosts.follower = None
    first, last = reader.receive(1000), reader.receive(1000)
    assert np.array_equal(first.t, packet(0).t) and last is END
    with pytest.raises(ValueError, match="no running graph"):
        choose("first")
