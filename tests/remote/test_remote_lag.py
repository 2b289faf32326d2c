"""A follower that hands nothing on for long, as one whose terminal is stopped: its process goes on afterwards."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest
import zmq
from two_hosts import EVENTS, Hosts, packet

from evis.bus import Subscriber, endpoints_for
from evis.remote import protocol
from evis.remote.follower import Follower
from evis.remote.keys import KeyPair
from msgs.camera import EventPacket

QUICK_HEARTBEATS = 20, 100
"""Their interval and the time for an answer [ms]: what takes a minute happens at once."""
KEEPALIVE = 2
"""Kind of a connection's timer in the kernel's table, of a probe."""


def lag(pipe: Connection, address: str, keys: tuple[KeyPair, bytes]) -> None:
    """Follows; does nothing from one word to the next; goes on until the connection is restored, and says how."""
    protocol.HEARTBEAT_MS, protocol.HEARTBEAT_TIMEOUT_MS = QUICK_HEARTBEATS
    said: list[str] = []
    follower = Follower(address, *keys, say=said.append)
    while follower.run is None:
        follower.follow()
    context = zmq.Context()
    where = endpoints_for(follower.run.plan.directory, EVENTS)
    reader = Subscriber(context, EVENTS, "tool", "tap", where, message_type=EventPacket, tap=True, every=True)
    reader.start()
    while not pipe.poll():
        follower.follow()
        reader.receive(0)
    pipe.send(pipe.recv())
    pipe.recv()
    before = follower.counters["messages"]
    while not any("connected again" in line for line in said) or not reader.receive(0):
        follower.follow()
    pipe.send((follower.counters["messages"] - before, follower.counters["breaks"]))
    reader.close()
    context.term()
    follower.close()


@pytest.fixture
def quick_hosts(folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> Iterator[Hosts]:
    for name, value in zip(("HEARTBEAT_MS", "HEARTBEAT_TIMEOUT_MS"), QUICK_HEARTBEATS):
        monkeypatch.setattr(protocol, name, value)
    hosts = Hosts(*folders, monkeypatch)
    yield hosts
    hosts.close()


def test_a_follower_that_lags_long_goes_on(quick_hosts: Hosts, monkeypatch: pytest.MonkeyPatch) -> None:
    """Heartbeats lay unread behind its full queue, the connection was made anew, and that ended its process."""
    hosts = quick_hosts
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(hosts.far))
    spawn = multiprocessing.get_context("spawn")
    pipe, theirs = spawn.Pipe()
    keys = hosts.follower_key, hosts.server_key.public
    process = spawn.Process(target=lag, args=(theirs, hosts.server.address, keys), daemon=True)
    process.start()
    theirs.close()
    sent = 0

    def send() -> None:
        nonlocal sent
        hosts.graph.publishers[EVENTS].send(packet(sent))
        sent += 1
        hosts.turn()

    def heard() -> Any:
        end = time.monotonic() + 60.0
        while not pipe.poll():
            assert time.monotonic() < end, "the follower says nothing"
            send()
            time.sleep(0.001)
        return pipe.recv()

    try:
        hosts.until(hosts.graph.publishers[EVENTS].tapped_by_eager)
        pipe.send("pause")
        assert heard() == "pause"
        for _ in range(4000):  # more than waits in the sockets of both sides and in the kernel
            send()
        pipe.send("go on")
        time.sleep(0.5)  # the server greets late, as one far away does
        messages, breaks = heard()
    finally:
        process.kill()
        process.join()
    assert messages > 0 and breaks >= 1


def test_a_server_that_is_silent_is_probed(hosts: Hosts) -> None:
    """By the kernel, whose table tells it: who only listens to a host that is gone would wait for ever."""
    hosts.connected()
    port = int(hosts.server.address.rpartition(":")[2])

    def timers() -> set[int]:
        rows = [row.split() for row in Path("/proc/net/tcp").read_text().splitlines()[1:]]
        return {int(row[5].partition(":")[0], 16) for row in rows if int(row[2].rpartition(":")[2], 16) == port}

    hosts.until(lambda: KEEPALIVE in timers())
