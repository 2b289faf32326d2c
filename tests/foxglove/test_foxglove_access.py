"""Who gets in: origins, names, the token and the protocol, asked for by hand."""

from __future__ import annotations

import http.client
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import yaml
from foxglove_node import LIMIT_S, Foxglove, Served
from websockets.exceptions import InvalidStatus

from evis.launch.arguments import ArgumentError
from evis.launch.planner import Options, plan_file
from nodes.foxglove.origins import may_read

UPGRADE = {
    "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Protocol": "foxglove.websocket.v1",
}  # fmt: skip


def ask(served: Served, path: str = "/", **headers: str) -> tuple[int, str]:
    """Status and text of the answer to a request for a WebSocket; a header "" is left out."""
    place = urlsplit(served.address)
    connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=LIMIT_S)
    given = {**UPGRADE, "Host": place.netloc, **{name.replace("_", "-"): value for name, value in headers.items()}}
    try:
        connection.request("GET", path, headers={name: value for name, value in given.items() if value})
        answer = connection.getresponse()
        return answer.status, "" if answer.status == 101 else answer.read().decode()
    finally:
        connection.close()


ORIGINS = {
    "http://localhost:3000": True, "https://localhost": True, "http://127.0.0.1:8080": True, "http://[::1]:80": True,
    "https://app.foxglove.dev": True, "https://studio.foxglove.dev": True, "https://HTTPS.Foxglove.dev": True,
    "https://lichtblick.example.org": True,
    "http://app.foxglove.dev": False, "https://foxglove.dev.evil.org": False, "https://evilfoxglove.dev": False,
    "https://app.foxglove.dev:8443": False, "https://app.foxglove.dev@evil.org": False,
    "https://evil.org/app.foxglove.dev": False, "https://evil.org#.foxglove.dev": False,
    "http://localhost.evil.org": False, "http://127.0.0.1.evil.org": False, "https://lichtblick.example.org:1": False,
    "null": False, "file://": True, "file://evil.org": False, "": False, "https://[": False,
    "http://localhost:x": False,
}  # fmt: skip


@pytest.mark.parametrize("origin", ORIGINS)
def test_origins(origin: str) -> None:
    assert may_read([origin], ["https://Lichtblick.example.org/"]) == ORIGINS[origin]


def test_a_program_says_no_origin_and_nobody_says_two() -> None:
    assert may_read([], []) and not may_read(["http://localhost", "http://localhost"], [])


def test_a_page_of_another_origin_is_refused_and_told_of(serve: Callable[..., Served]) -> None:
    served = serve(origins=["https://mine.org"])
    assert ask(served, Origin="https://mine.org")[0] == ask(served, Origin="http://localhost:8080")[0] == 101
    status, text = ask(served, Origin="https://evil.org")
    assert status == 403 and text.startswith("403: pages of this origin")
    served.node.idle()
    assert served.runtime.said == [
        "a page of https://evil.org was refused; origins:=https://evil.org lets it read the graph"
    ]
    assert served.runtime.counted["requests_refused"] == 1


@pytest.mark.parametrize("host", ["evil.org", "evil.org:8765", "localhost.evil.org", "127.0.0.1@evil.org"])
def test_a_foreign_name_gets_nothing(serve: Callable[..., Served], host: str) -> None:
    """DNS rebinding: a page's own name leads here."""
    served = serve(names=["proxy.lab"])
    assert ask(served, Host=host)[0] == 403
    assert ask(served, Host="localhost:1")[0] == ask(served, Host="Proxy.Lab")[0] == 101


def test_a_token_is_part_of_the_address(serve: Callable[..., Served]) -> None:
    served = serve(token="long-enough")
    with Foxglove(served.address) as client:
        assert served.address.endswith("/long-enough") and client.channels
    for path in ("/", "/long-enoug", "/long-enough/", "/long-enough/x", "/x/long-enough", "/?token=long-enough"):
        status, text = ask(served, path)
        assert status == 403 and "needs its token" in text and "long-enough" not in text
    assert served.runtime.hidden == ["long-enough"] and "long-enough" not in served.runtime.told[0]


def test_without_a_token_there_is_one_address(served: Served) -> None:
    assert ask(served, "/")[0] == 101 and ask(served, "/anything")[0] == 403


def test_beyond_loopback_a_token_must_be_given(serve: Callable[..., Served]) -> None:
    with pytest.raises(ValueError, match=r"host 0\.0\.0\.0 is reachable from other machines: give a token"):
        serve(host="0.0.0.0")
    assert "0.0.0.0" in serve(host="0.0.0.0", token="long-enough").address


def test_a_short_token_is_refused(serve: Callable[..., Served]) -> None:
    with pytest.raises(ValueError, match="a secret of 5 characters"):
        serve(token="short")


def test_a_port_that_is_taken_is_told(serve: Callable[..., Served]) -> None:
    """And none is chosen instead: a client asks for the one that it knows. The remedy serves a launch file too."""
    port = urlsplit(serve().address).port
    with pytest.raises(OSError, match=f"port {port} is taken; choose another .port:=0 is any free one") as told:
        serve(port=port)
    written = yaml.safe_load("{" + str(told.value).partition("in a launch file ")[2].rstrip(")") + "}")
    assert serve(**written["params"]).address.startswith("ws://127.0.0.1:")


def test_a_launch_file_that_serves_others_without_a_token_is_refused_before_the_start(tmp_path: Path) -> None:
    file = tmp_path / "graph.yaml"
    text = """
args: {scene: {default: spinning_disk}}
include: simulator
nodes:
  foxglove: {type: foxglove, tap: true, params: {port: 0, host: 0.0.0.0TOKEN}}
"""
    file.write_text(text.replace("TOKEN", ""))
    with pytest.raises(ArgumentError, match=r"graph.yaml:5: 'foxglove': host 0\.0\.0\.0 is reachable from other"):
        plan_file(file, {}, Options())
    file.write_text(text.replace("TOKEN", ", token: long-enough"))
    assert "foxglove" in plan_file(file, {}, Options()).nodes


@pytest.mark.parametrize("offered", ["", "chat", "foxglove.websocket.v2, chat"])
def test_who_speaks_another_protocol_is_told(served: Served, offered: str) -> None:
    status, text = ask(served, Sec_WebSocket_Protocol=offered)
    assert (status, text) == (400, "400: a WebSocket of foxglove.websocket.v1 or foxglove.sdk.v1 is served here\n")


@pytest.mark.parametrize("offered", ["foxglove.websocket.v1", "foxglove.sdk.v1"])
def test_the_protocol_is_chosen_of_those_offered(served: Served, offered: str) -> None:
    with Foxglove(served.address, subprotocols=["chat", offered]) as client:
        assert client.ws.subprotocol == offered


def test_no_websocket_at_all_is_one_line(served: Served) -> None:
    status, text = ask(served, Connection="close", Upgrade="")
    assert status == 400 and text.count("\n") <= 1
    with pytest.raises(InvalidStatus), Foxglove(served.address + "/nothing"):
        pass
    served.node.idle()
    assert served.runtime.said == []
