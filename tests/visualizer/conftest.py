"""Fixtures: a visualizer on a made-up graph, a client that speaks the page's protocol, and a browser that shows it."""

from __future__ import annotations

import json
import os
import shutil
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from browser_panels import LIMIT_S
from page_show import Show
from synthetic_graph import make_node, make_plan

from evis.runtime.plan import Plan

FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()


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


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium with an empty profile; skipped where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    playwright.expect.set_options(timeout=1000 * LIMIT_S)
    chromium = shutil.which("chromium")
    if chromium is None:
        assert not os.environ.get("EVIS_REQUIRE_BROWSER"), "EVIS_REQUIRE_BROWSER is set and there is no chromium"
        pytest.skip("chromium is not installed (apt-get install chromium)")
    with tempfile.TemporaryDirectory() as profile, playwright.sync_playwright() as driver:
        context = driver.chromium.launch_persistent_context(
            profile, executable_path=chromium, headless=True, args=FLAGS, viewport={"width": 1280, "height": 900},
            timeout=2000 * LIMIT_S,
        )  # fmt: skip
        context.set_default_timeout(1000 * LIMIT_S)
        yield context
        context.close()


@pytest.fixture
def show(browser: Any) -> Iterator[Callable[..., Show]]:
    """Opens pages: show(plan, width, height)."""
    opened: list[Show] = []

    def make(plan: Plan, width: int = 1280, height: int = 800) -> Show:
        opened.append(Show(browser, plan, width, height))
        return opened[-1]

    yield make
    for one in opened:
        one.close()


@pytest.fixture
def private_runs(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Run directories of this test alone, in a folder with a short path, as sockets need it."""
    with tempfile.TemporaryDirectory(prefix="ev", dir="/tmp", ignore_cleanup_errors=True) as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        monkeypatch.delenv("EVIS_NO_VIEW", raising=False)
        yield Path(folder)
