"""Fixtures: a visualizer on a made-up graph, and a client that speaks the page's protocol."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from synthetic_graph import make_node, make_plan

LIMIT_S = 60.0
"""For all that is waited for: far more than a loaded machine needs."""


class PageClient:
    """One WebSocket, as the page opens it. Acknowledges only when told to."""

    def __init__(self, url: str) -> None:
        self.page, _, self.token = url.partition("?token=")
        self.seen: dict[str, dict[str, Any]] = {}

    async def __aenter__(self) -> PageClient:
        self.http = aiohttp.ClientSession()
        self.ws = await self.http.ws_connect(f"{self.page}{self.token}/ws")
        self.hello = json.loads((await self.ws.receive(LIMIT_S)).data)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.http.close()

    async def show(self, *panels: tuple[str, str, str, int]) -> None:
        keys = ("id", "topic", "view", "env")
        await self.ws.send_json({"op": "panels", "panels": [dict(zip(keys, p)) for p in panels]})

    async def ack(self) -> None:
        await self.ws.send_json({"op": "ack"})

    async def bundle(self, timeout: float = LIMIT_S) -> list[dict[str, Any]]:
        """Parts of the next bundle, each with its payload."""
        message = await self.ws.receive(timeout)
        assert message.type is aiohttp.WSMsgType.BINARY, message
        data = message.data
        (length,) = struct.unpack_from("<I", data)
        parts = json.loads(data[4 : 4 + length])
        offset = 4 + length
        for part in parts:
            part["payload"] = data[offset : offset + part["bytes"]]
            offset += -(-part["bytes"] // 4) * 4
            self.seen[part["panel"]] = part
        assert offset == len(data)
        return parts

    async def part(self, panel: str, pump: Callable[[], None]) -> dict[str, Any]:
        """The next part of a panel; `pump` makes the graph go on, everything is acknowledged."""
        deadline = time.monotonic() + LIMIT_S
        while time.monotonic() < deadline:
            pump()
            try:
                parts = await self.bundle(0.2)
            except TimeoutError:
                continue
            await self.ack()
            for part in parts:
                if part["panel"] == panel:
                    return part
        raise AssertionError(f"nothing came for {panel}")


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Any]:
    """A visualizer on the made-up graph, with nobody playing it."""
    visualizer = make_node(make_plan(tmp_path))
    yield visualizer
    visualizer.close()


@pytest.fixture
def url(node: Any, tmp_path: Path) -> str:
    """The address that the node left for `evis view`."""
    return json.loads((tmp_path / "viewer.json").read_text())["url"]


@pytest.fixture
def client(url: str) -> Callable[[], PageClient]:
    """Makes clients of the node's page."""
    return lambda: PageClient(url)
