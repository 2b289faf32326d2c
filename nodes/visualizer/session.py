"""Serves one open page: which panels it has, its one credit, and the bundles it gets.

The page acknowledges a bundle after drawing it, and only then gets the next, made of the newest of each panel at that
moment. A slow or dead browser costs at most one bundle of memory.

From the page (JSON): {"op": "panels", "panels": [{"id", "topic", "view", "env"}]} says all that is open, {"op": "ack"}
gives the credit back. To the page: {"op": "hello", ...} once, {"op": "error", "text"}, {"op": "end", "failure"}, and
bundles: a little-endian uint32 length, a JSON list of parts ({"panel", "kind", "bytes", ...meta}), and their payloads
in order.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import struct
import time
from concurrent.futures import Executor
from typing import Any

from aiohttp import WSMsgType, web

from evis.web.gate import REFUSED
from nodes.visualizer import catalog
from nodes.visualizer.hub import Hub, PanelKey
from nodes.visualizer.statistics import plain
from nodes.visualizer.views.part import PanelPart, TopicView

MOST_BYTES = 1 << 16
"""Longest message of a page."""
LONGEST_ID = 256
"""Longest id of a panel [characters]; each bundle repeats it."""
LONGEST_ERROR = 200
"""Longest text of an answer to nonsense [characters]."""
STATUS_S = 0.5
"""Interval of the rates on the page [s]."""


def bundle(parts: list[tuple[str, PanelPart]]) -> bytes:
    """Packs (panel id, part) pairs into their wire form."""
    head = [{"panel": i, "kind": p.kind, "bytes": len(p.payload), **p.meta} for i, p in parts]
    try:
        text = json.dumps(head, allow_nan=False, separators=(",", ":")).encode()
    except ValueError:  # a number that is none, as a recording may have it
        text = json.dumps(plain(head), allow_nan=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)  # payloads of 32-bit words start aligned
    body = b"".join(p.payload + b"\0" * (-len(p.payload) % 4) for _, p in parts)
    return struct.pack("<I", len(text)) + text + body


class Session:
    """Serves one page, as long as its WebSocket lives."""

    def __init__(self, hub: Hub, ws: web.WebSocketResponse, encoder: Executor, max_fps: float) -> None:
        self._hub = hub
        self._ws = ws
        self._encoder = encoder
        self._period = 1 / max_fps
        self._max_fps = max_fps
        self._panels: dict[str, PanelKey] = {}
        self._sent: dict[str, tuple[TopicView, int]] = {}
        """By panel the view and the version of its last part: a view that is made anew counts from 1 again."""
        self._credit = asyncio.Event()
        self._news = asyncio.Event()
        self._status_due = 0.0

    async def run(self) -> None:
        """Serves until the page goes away."""
        loop = asyncio.get_running_loop()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody is left to be woken
                loop.call_soon_threadsafe(self._news.set)

        self._hub.join(self, wake)
        writer = None
        try:
            await self._ws.send_json(catalog.describe(self._hub.plan, self._max_fps))
            self._credit.set()
            writer = asyncio.create_task(self._write())
            async for message in self._ws:
                if message.type is WSMsgType.TEXT:
                    await self._hear(message.data)
                elif message.type is WSMsgType.BINARY:
                    await self._refuse("messages are JSON text")
        except (ConnectionError, asyncio.CancelledError):
            pass
        finally:
            self._hub.leave(self)
            if writer is not None:
                writer.cancel()
                await asyncio.gather(writer, return_exceptions=True)

    async def _hear(self, text: str) -> None:
        try:
            message = _map(json.loads(text), "a message")
            op = message.get("op")
            if op == "ack":
                self._credit.set()
            elif op == "panels":
                panels = message.get("panels")
                if not isinstance(panels, list):
                    raise ValueError("panels must be a list")
                self._open(dict(map(_panel, panels)))
            else:
                raise ValueError(f"unknown op '{op}'")
        except RecursionError:
            await self._refuse("the message is nested too deeply")
        except ValueError as error:
            await self._refuse(str(error))

    async def _refuse(self, text: str) -> None:
        self._hub.count(REFUSED)
        await self._ws.send_json({"op": "error", "text": text[:LONGEST_ERROR]})

    def _open(self, panels: dict[str, PanelKey]) -> None:
        self._hub.show(self, frozenset(panels.values()))
        self._sent = {i: v for i, v in self._sent.items() if panels.get(i) == self._panels.get(i)}
        self._panels = panels
        self._news.set()

    async def _write(self) -> None:
        loop = asyncio.get_running_loop()
        earliest = 0.0
        while True:
            await self._credit.wait()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), max(self._status_due - time.monotonic(), 0.001))
            await asyncio.sleep(earliest - time.monotonic())
            self._news.clear()
            asked = dict(self._panels)
            found = await loop.run_in_executor(self._encoder, self._collect, asked, dict(self._sent))
            found = [
                (i, view, part) for i, view, part in found if self._panels.get(i) == asked[i]
            ]  # not closed meanwhile
            self._sent |= {i: (view, part.version) for i, view, part in found}
            parts = [(i, part) for i, _, part in found]
            if time.monotonic() >= self._status_due:
                self._status_due = time.monotonic() + STATUS_S
                parts.append(("", PanelPart("status", 0, self._hub.status())))
            if not parts:
                continue
            self._credit.clear()
            earliest = time.monotonic() + self._period
            try:
                await self._ws.send_bytes(bundle(parts))
            except (ConnectionError, RuntimeError):
                return

    def _collect(
        self, panels: dict[str, PanelKey], sent: dict[str, tuple[TopicView, int]]
    ) -> list[tuple[str, TopicView, PanelPart]]:
        """Makes the newest part of every panel that has one, on the encoding thread: (panel, its view, part)."""
        found = []
        for panel, key in panels.items():
            view = self._hub.view(key)
            if view is None:
                continue
            before, version = sent.get(panel, (view, 0))
            try:
                part = view.render(version if view is before else 0)
            except Exception as error:
                self._hub.refuse(key.topic, f"{type(error).__name__}: {error}")
                continue
            if part is not None:
                found.append((panel, view, part))
        return found


def _map(value: Any, what: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{what} must be a map")
    return value


def _panel(given: Any) -> tuple[str, PanelKey]:
    """Parses a panel that a page asks for: (id, key). Raises ValueError."""
    panel = _map(given, "a panel")
    for name in ("id", "topic", "view"):
        if not isinstance(panel.get(name), str):
            raise ValueError(f"a panel needs '{name}', a text")
    if len(panel["id"]) > LONGEST_ID:
        raise ValueError(f"a panel's id has {len(panel['id'])} characters, the most is {LONGEST_ID}")
    env = panel.get("env", 0)
    if type(env) is not int or not 0 <= env < 1 << 20:
        raise ValueError(f"environment {env!r} is not a number >= 0")
    return panel["id"], PanelKey(panel["topic"], panel["view"], env)
