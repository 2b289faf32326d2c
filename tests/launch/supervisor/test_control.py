"""The wire between supervisor and processes."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq

from evis.runtime.process import control
from evis.runtime.process.control import ControlClient, ControlServer, ask_for, control_address


@pytest.fixture
def server(runtime: Path) -> Iterator[ControlServer]:
    server = ControlServer(control_address(str(runtime)))
    yield server
    server.close()


def until(server: ControlServer, key: str, timeout_s: float = 60.0) -> tuple[str, dict[str, Any]]:
    """The first message with `key`."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        for process, message in server.poll(0.1):
            if key in message:
                return process, message
    raise AssertionError(f"no {key}")


def test_ready_go_stop_done(server: ControlServer, runtime: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control, "BYE_S", 1e9)  # the answer ends the wait
    client = ControlClient(control_address(str(runtime)), "sensor")
    client.ready()
    assert until(server, "ready")[0] == "sensor"
    looks: list[int] = []

    def meanwhile() -> None:
        looks.append(1)
        if len(looks) == 5:  # nobody has said go before
            server.send("sensor", {"go": 1})

    assert client.wait_go(meanwhile) is True and len(looks) >= 5
    server.send("sensor", {"stop": 1})
    end = time.monotonic() + 60
    while not (commands := client.poll(0.1)) and time.monotonic() < end:
        pass
    assert commands == [{"stop": 1}]
    client.done({"nodes": {"a": {"events": 3}}})
    closing = threading.Thread(target=client.close, daemon=True)
    closing.start()
    assert until(server, "done")[1]["summary"] == {"nodes": {"a": {"events": 3}}}
    server.send("sensor", {"bye": 1})
    closing.join(60)
    assert not closing.is_alive()


def test_stop_before_go_ends_the_wait(server: ControlServer, runtime: Path) -> None:
    client = ControlClient(control_address(str(runtime)), "a")
    client.ready()
    until(server, "ready")
    server.send("a", {"stop": 1})
    assert client.wait_go(lambda: None) is False
    client.close()


def test_heartbeats_go_on_while_the_node_is_busy_and_tell_for_how_long(server: ControlServer, runtime: Path) -> None:
    client = ControlClient(control_address(str(runtime)), "a")
    client.heartbeat({"events": 7})
    beats: list[dict[str, Any]] = []
    while len(beats) < 3:  # this thread says nothing meanwhile, as in a long update
        beat = until(server, "heartbeat")[1]
        beats += [beat] if beat["stats"] == {"events": 7} else []
    assert beats[2]["busy_s"] >= beats[1]["busy_s"] + 0.9 * control.HEARTBEAT_S
    client.close()


def test_the_last_message_arrives_though_the_sender_closes_at_once(server: ControlServer, runtime: Path) -> None:
    client = ControlClient(control_address(str(runtime)), "a")
    client.failed("node", "text")
    client.close()  # nobody says bye: 2 s
    process, message = until(server, "failed")
    assert (process, message["node"], message["text"]) == ("a", "node", "text")


def test_a_gone_supervisor_does_not_hold_a_process(runtime: Path) -> None:
    client = ControlClient(control_address(str(runtime)), "a")
    client.done({})
    closing = threading.Thread(target=client.close, daemon=True)
    closing.start()
    closing.join(60)
    assert not closing.is_alive()


def test_noise_and_strangers_do_no_harm(server: ControlServer, runtime: Path) -> None:
    context = zmq.Context()
    stranger = context.socket(zmq.DEALER)
    stranger.connect(control_address(str(runtime)))
    for frames in ([b""], [b"\xc1"], [b"\x93\x01"], [b"\x01"], [b"\xff" * 1000], [b"a", b"b", b"c"]):
        stranger.send_multipart(frames)
    ask_for(str(runtime), "/cam0/labels")
    assert until(server, "want")[1] == {"want": "/cam0/labels"}
    server.send("nobody", {"go": 1})
    stranger.close(linger=0)
    context.term()


def test_an_error_that_names_a_file_whose_name_is_not_utf8_is_told(server: ControlServer, runtime: Path) -> None:
    client = ControlClient(control_address(str(runtime)), "reader")
    client.failed("reader", "a\udcff.raw: No such file or directory")
    assert until(server, "failed")[1]["text"] == "a\udcff.raw: No such file or directory"
    server.send("reader", {"bye": 1})
    client.close()
