"""Who can reach a topic: the user, on this machine, through a directory of his own."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from bus_workers import TOPIC, publisher_on

from evis.bus import BusError, Endpoints, endpoints_for
from evis.bus.endpoints import outside_socket


@pytest.mark.parametrize(
    "address",
    ["tcp://127.0.0.1:5555", "tcp://*:0", "tcp://[::]:0", "ipc://@abstract", "ipc://*", "ipc://a.data", "inproc://a"],
)
def test_an_address_that_others_could_reach_is_refused(context, address, endpoints, monkeypatch):
    """Even with permissions that would do for a file: nothing is bound beside the run's directory."""
    monkeypatch.chdir(Path(endpoints.tap.removeprefix("ipc://")).parent)
    for addresses in (address, *tuple(endpoints)[1:]), (*tuple(endpoints)[:2], address):
        with pytest.raises(BusError, match=re.escape(f"{address}: a topic is bound to ipc://")):
            publisher_on(context, Endpoints(*addresses), [])
    assert list(Path.cwd().iterdir()) == []


def test_an_open_directory_a_long_path_and_a_second_publisher_are_refused(context, endpoints, tmp_path):
    long = tmp_path / ("x" * 100)
    with pytest.raises(BusError, match="XDG_RUNTIME_DIR to a shorter folder"):
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


def test_long_names_have_sockets_of_their_own(tmp_path):
    """The system allows 107 bytes, and a camera may be called by more: a file is bound at each."""
    long = "a_camera_with_a_very_long_name_on_the_left_front_corner_of_the_robot"
    names = [f"/{long}{end}/{tail}" for end in ("", "2", "é" * 9) for tail in ("events", "frames")]
    found = [*(a.removeprefix("ipc://") for n in names for a in endpoints_for("/tmp/evis-0/20261129-020645-8de5a2", n))]
    found += [str(outside_socket("/tmp/evis-0/20261129-020645-8de5a2", f"renderer_{long}"))]
    assert len(set(found)) == 19 and max(len(os.fsencode(path)) for path in found) <= 107
    short = endpoints_for("/run/x", "/cam0/events")
    assert short.tap == "ipc:///run/x/cam0~events.tap"
    assert str(outside_socket("/run/x", "a/physics")) == "/run/x/a~physics.door"
    assert str(outside_socket("/run/x", "a.b")) == "/run/x/a.b.door"
