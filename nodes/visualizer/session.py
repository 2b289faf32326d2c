"""One open page: which panels it has, its one credit, and the bundles it gets.

From the page (JSON): {"op": "panels", "panels": [{"id", "topic", "view", "env"}]} says all that is open, {"op": "ack"}
gives the credit back. To the page: {"op": "hello", ...} once, {"op": "error", "text"}, {"op": "end"}, and bundles: a
little-endian uint32 length, a JSON list of parts ({"panel", "kind", "bytes", ...meta}), and their payloads in order.
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

from nodes.visualizer import catalog
from nodes.visualizer.hub import Hub, PanelKey
from nodes.visualizer.views.part import Part

STATUS_S = 0.5
"""Interval of the rates on the page [s]."""


def bundle(parts: list[tuple[str, Part]]) -> bytes:
    """The wire form of (panel id, part) pairs."""
    head = [{"panel": i, "kind": p.kind, "bytes": len(p.payload), **p.meta} for i, p in parts]
    text = json.dumps(head, allow_nan=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)  # payloads of 32-bit words start aligned
    body = b"".join(p.payload + b"\0" * (-len(p.payload) % 4) for _, p in parts)
    return struct.pack("<I", len(text)) + text + body


class Session:
    """Lives as long as its WebSocket."""

    def __init__(self, hub: Hub, ws: web.WebSocketResponse, encoder: Executor, max_fps: float) -> None:
        self._hub = hub
        self._ws = ws
        self._encoder = encoder
        self._period = 1 / max_fps
        self._max_fps = max_fps
        self._panels: dict[str, PanelKey] = {}
        self._sent: dict[str, int] = {}
        self._credit = asyncio.Event()
        self._news = asyncio.Event()
        self._status_due = 0.0

    async def run(self) -> None:
        """Until the page goes away."""
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
        except (ConnectionError, asyncio.CancelledError):
            pass
        finally:
            self._hub.leave(self)
            if writer is not None:
                writer.cancel()
                await asyncio.gather(writer, return_exceptions=True)

    async def _hear(self, text: str) -> None:
        try:
            message = json.loads(text)
            op = message["op"]
            if op == "ack":
                self._credit.set()
            elif op == "panels":
                self._open({str(p["id"]): _key(p) for p in message["panels"]})
            else:
                raise ValueError(f"unknown op '{op}'")
        except (ValueError, KeyError, TypeError) as error:
            await self._ws.send_json({"op": "error", "text": str(error)})

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
            parts = await loop.run_in_executor(self._encoder, self._collect, asked, dict(self._sent))
            parts = [(i, part) for i, part in parts if self._panels.get(i) == asked[i]]  # not closed meanwhile
            if time.monotonic() >= self._status_due:
                self._status_due = time.monotonic() + STATUS_S
                parts.append(("", Part("status", 0, self._hub.status())))
            if not parts:
                continue
            self._sent |= {panel: part.version for panel, part in parts}
            self._credit.clear()
            earliest = time.monotonic() + self._period
            try:
                await self._ws.send_bytes(bundle(parts))
            except (ConnectionError, RuntimeError):
                return

    def _collect(self, panels: dict[str, PanelKey], sent: dict[str, int]) -> list[tuple[str, Part]]:
        """On the encoding thread: the newest part of every panel that has one."""
        parts = []
        for panel, key in panels.items():
            view = self._hub.view(key)
            if view is None:
                continue
            try:
                part = view.render(sent.get(panel, 0))
            except Exception as error:
                self._hub.refuse(key.topic, f"{type(error).__name__}: {error}")
                continue
            if part is not None:
                parts.append((panel, part))
        return parts


def _key(panel: Any) -> PanelKey:
    env = panel.get("env", 0)
    if not isinstance(env, int) or not 0 <= env < 1 << 20:
        raise ValueError(f"environment {env!r} is not a number >= 0")
    return PanelKey(str(panel["topic"]), str(panel["view"]), env)
