"""Who can reach a topic: private directories, addresses beyond this machine, and keys."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
import zmq
from bus_workers import TOPIC, loopback, publisher_on, send_stream, subscriber_on, truth, wait_for

from evis.bus import BusError, endpoints_for, tcp_endpoints


@pytest.mark.parametrize("host", ["*", "0.0.0.0", "192.168.1.5", "eth0", "example.org", "[::]"])
def test_an_unkeyed_bind_beyond_loopback_is_refused(context, host):
    with pytest.raises(BusError, match="could be reached from other machines: give CURVE keys"):
        publisher_on(context, tcp_endpoints(host, 5555), [])


def test_an_open_directory_a_long_path_and_a_second_publisher_are_refused(context, endpoints, tmp_path):
    long = tmp_path / ("x" * 100)
    with pytest.raises(BusError, match="shorter run directory"):
        endpoints_for(long, TOPIC)
    shared = Path("/tmp").stat().st_mode & 0o077
    assert shared
    with pytest.raises(BusError, match="0700"):
        publisher_on(context, endpoints_for("/tmp", TOPIC), [])
    first = publisher_on(context, endpoints, [])
    with pytest.raises(BusError, match="already publishes this topic"):
        publisher_on(context, endpoints, [])
    first.close()
    assert not any(os.path.exists(a.removeprefix("ipc://")) for a in endpoints)


def test_topics_never_share_a_socket():
    names = {endpoints_for("/run", t).lockstep for t in ("/a/b", "/a.b", "/a-b", "/a_b", "/ab", "/a/b.tap")}
    assert len(names) == 6


def test_curve_keys_open_tcp_and_strangers_stay_out(context, reader):
    public, secret = (key.decode() for key in zmq.curve_keypair())
    publisher = publisher_on(context, tcp_endpoints("0.0.0.0", 0, public), ["labeler:in"], secret_key=secret)
    lockstep, credit, tap = (a.replace("0.0.0.0", "127.0.0.1") for a in publisher.endpoints)
    keyed = type(publisher.endpoints)(lockstep, credit, tap, public)
    stranger = subscriber_on(context, type(keyed)(lockstep, credit, tap), "labeler")
    wrong = subscriber_on(context, type(keyed)(lockstep, credit, tap, zmq.curve_keypair()[0].decode()), "labeler")
    time.sleep(0.2)
    assert publisher.missing() == ["labeler:in"] and not stranger.connected() and not wrong.connected()
    child = reader(keyed, "labeler")
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, 20)
    assert publisher.finish(60)
    assert child.hear()["hash"] == truth(20)
    for one in publisher, stranger, wrong:
        one.close()


def test_loopback_tcp_needs_no_keys(context):
    publisher = publisher_on(context, loopback(), [])
    assert all(a.startswith("tcp://127.0.0.1:") for a in publisher.endpoints)
    publisher.close()
