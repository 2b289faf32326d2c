"""The page under attack as a user serves it, with 1024 open files: what was tried, how often, and what came of it.

pytest -m slow -s tests/adversary/test_web_attacks.py     # prints a row of figures for each attack
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import signal
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import psutil
import pytest

pytestmark = pytest.mark.slow
LIMIT_S = 120.0
FILES = 1024
MB = 1 << 20
LOG_BYTES = 1 << 16
"""Most that an attack may write into the logs, which lie in memory."""
GROWTH = 200 * MB
"""Most that an attack may cost the visualizer."""


class Site:
    """`evis view` of a recording, and its visualizer's process."""

    def __init__(self, folder: Path, runtime: Path) -> None:
        count = 20000
        t = np.arange(count, dtype=np.int64) * 500_000
        x, y = (np.arange(count) % n for n in (173, 130))
        p = (np.arange(count) % 2).astype(np.uint8)
        np.savez(folder / "a.npz", t=t, x=x.astype(np.uint16), y=y.astype(np.uint16), p=p)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "evis", "view", str(folder / "a.npz"), "--port", "0", "--json"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "XDG_RUNTIME_DIR": str(runtime)},
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, FILES)),
        )  # fmt: skip
        assert self.process.stdout is not None
        self.url = json.loads(self.process.stdout.readline())["url"]
        page, _, self.token = self.url.partition("?token=")
        self.port = int(page.rpartition(":")[2].strip("/"))
        self.ws = f"{page}{self.token}/ws"
        end = time.monotonic() + LIMIT_S
        while not (found := list((runtime / "evis").glob("*/viewer.json"))):
            assert time.monotonic() < end and self.process.poll() is None
            time.sleep(0.05)
        self.folder = found[0].parent
        self.viewer = psutil.Process(json.loads(found[0].read_text())["pid"])

    def files(self) -> int:
        """Open files of the visualizer."""
        return self.viewer.num_fds()

    def memory(self) -> int:
        """Resident memory of the visualizer [bytes]."""
        return self.viewer.memory_info().rss

    def logged(self) -> int:
        """Size of all logs of the run [bytes]."""
        return sum(path.stat().st_size for path in self.folder.glob("*.log"))

    async def open(self, sent: bytes = b"") -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """A connection over which `sent` has gone."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        writer.write(sent)
        return reader, writer

    def end(self) -> str:
        """Ctrl-C; what it said."""
        self.process.send_signal(signal.SIGINT)
        try:
            return self.process.communicate(timeout=LIMIT_S)[1]
        finally:
            self.process.kill()


@pytest.fixture
def site(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    import shutil
    import tempfile

    runtime = Path(tempfile.mkdtemp(prefix="ev", dir="/tmp"))  # short, because a socket's path is limited
    made = Site(tmp_path, runtime)
    try:
        yield made
    finally:
        said = made.end()
        shutil.rmtree(runtime, ignore_errors=True)
    assert "Traceback" not in said and made.token not in said, said


class Viewer:
    """A page that somebody looks at: it counts the bundles with events that it gets."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.bundles = 0

    async def __aenter__(self) -> Viewer:
        self._http = aiohttp.ClientSession()
        self._ws = await self._http.ws_connect(self.site.ws)
        topic = next(t["name"] for t in (await self._ws.receive_json())["topics"] if t["type"] == "EventPacket")
        panel = {"id": "e", "topic": topic, "view": "events", "env": 0}
        await self._ws.send_json({"op": "panels", "panels": [panel]})
        self._task = asyncio.create_task(self._look())
        await self.sees()
        return self

    async def _look(self) -> None:
        async for message in self._ws:
            assert message.type is aiohttp.WSMsgType.BINARY, message
            self.bundles += b'"panel":"e"' in message.data
            await self._ws.send_json({"op": "ack"})

    async def sees(self) -> None:
        """Until three more bundles have come."""
        aim = self.bundles + 3
        async with asyncio.timeout(LIMIT_S):
            while self.bundles < aim:
                assert not self._task.done(), "the page was closed"
                await asyncio.sleep(0.05)

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        await self._http.close()


async def fetches(site: Site) -> None:
    """Somebody new with the token gets the page."""
    timeout = aiohttp.ClientTimeout(LIMIT_S)
    async with aiohttp.ClientSession(timeout=timeout) as http, http.get(site.url) as response:
        assert response.status == 200


def attacked(site: Site, name: str, attack: Callable[[Counter[str]], Awaitable[None]]) -> Counter[str]:
    """Run an attack while somebody looks and others come; the figures of it. Fails where a bound does not hold."""
    figures: Counter[str] = Counter()

    async def main() -> None:
        async with Viewer(site) as viewer:
            before, logged = site.memory(), site.logged()
            task = asyncio.ensure_future(attack(figures))
            while not task.done():
                await fetches(site)
                await viewer.sees()
                figures["pages fetched meanwhile"] += 1
                figures["most files"] = max(figures["most files"], site.files())
                figures["most growth MB"] = max(figures["most growth MB"], (site.memory() - before) // MB)
                await asyncio.sleep(0.2)
            await task
            await viewer.sees()
            figures["bytes of log"] = site.logged() - logged
            figures["bundles meanwhile"] = viewer.bundles

    asyncio.run(main())
    print(f"\n{name}: {dict(figures)}")
    assert site.viewer.is_running() and site.process.poll() is None
    assert figures["most files"] < FILES and figures["bytes of log"] <= LOG_BYTES
    assert figures["most growth MB"] * MB <= GROWTH
    return figures


HEAD = b"GET / HTTP/1.1\r\nHost: localhost\r\nX-A: "


def test_1100_half_open_requests(site: Site) -> None:
    """Held for 20 s; each one that is closed is opened anew."""

    async def hold(end: float, figures: Counter[str]) -> None:
        while time.monotonic() < end:
            with contextlib.suppress(ConnectionError):
                reader, writer = await site.open(HEAD)
                figures["opened"] += 1
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(reader.read(), max(end - time.monotonic(), 0.01))
                    figures["closed by the page"] += 1
                writer.close()
            await asyncio.sleep(0.5)

    async def attack(figures: Counter[str]) -> None:
        end = time.monotonic() + 20
        await asyncio.gather(*(hold(end, figures) for _ in range(1100)))

    figures = attacked(site, "half-open requests, 1,100 at a time", attack)
    assert figures["opened"] >= 1100 and figures["closed by the page"] >= 1100 - 256


def test_200_slow_senders(site: Site) -> None:
    """A byte of the head each second, and of a body that never ends."""

    async def drip(start: bytes, figures: Counter[str]) -> None:
        reader, writer = await site.open(start)
        figures["opened"] += 1
        for _ in range(60):
            writer.write(b"x")
            with contextlib.suppress(TimeoutError, ConnectionError):
                while await asyncio.wait_for(reader.read(1 << 16), 1):
                    pass
            if reader.at_eof() or reader.exception():
                figures["closed by the page"] += 1
                break
        writer.close()

    async def attack(figures: Counter[str]) -> None:
        post = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000000000\r\n\r\n"
        await asyncio.gather(*(drip(start, figures) for start in [HEAD, post] * 100))

    figures = attacked(site, "slow senders, a byte a second", attack)
    assert figures["closed by the page"] == 200


def test_a_minute_of_garbage(site: Site) -> None:
    """What is no HTTP, what is no host, what has no token: some hundred a second."""
    rng = np.random.default_rng(11)

    def junk() -> bytes:
        return [
            rng.bytes(400) + b"\r\n\r\n",
            b"\x16\x03\x01\x02\x00" + rng.bytes(200),
            b"GET /" + rng.bytes(40).hex().encode() + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
            b"GET /\xff\xfe/ws HTTP/1.1\r\nHost: localhost\r\n\r\n",
            b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n",
            b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"A: b\r\n" * 3000,
            b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 70000\r\n\r\n" + b"x" * 70000,
        ][rng.integers(7)]

    async def send(end: float, figures: Counter[str]) -> None:
        while time.monotonic() < end:
            figures["requests"] += 1
            with contextlib.suppress(ConnectionError):
                reader, writer = await site.open(junk())
                with contextlib.suppress(TimeoutError):
                    answer = await asyncio.wait_for(reader.read(), 0.5)
                    figures[f"answered {answer[9:12].decode()}" if answer else "closed"] += 1
                    assert answer[9:12] in (b"", b"400", b"403"), answer
                writer.close()
            await asyncio.sleep(0.05)

    async def attack(figures: Counter[str]) -> None:
        end = time.monotonic() + 60
        await asyncio.gather(*(send(end, figures) for _ in range(16)))

    attacked(site, "a minute of garbage", attack)


def test_500_stuck_viewers(site: Site) -> None:
    """They have the token, open a panel, and never read nor answer."""
    head = f"GET /{site.token}/ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    head += "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    ask = json.dumps({"op": "panels", "panels": [{"id": "e", "topic": "/cam0/events", "view": "events"}]}).encode()

    async def attack(figures: Counter[str]) -> None:
        held = []
        for _ in range(500):
            reader, writer = await asyncio.open_connection("127.0.0.1", site.port, limit=1024)
            writer.write(head.encode())
            figures["let in"] += (await reader.readexactly(12)) == b"HTTP/1.1 101"
            writer.transport.pause_reading()  # type: ignore[attr-defined]
            writer.write(struct.pack(">BBQI", 0x81, 0xFF, len(ask), 0) + ask)
            held.append(writer)
        await asyncio.sleep(8)
        for writer in held:
            writer.transport.abort()

    figures = attacked(site, "stuck viewers with the token", attack)
    assert figures["let in"] == 500


def test_a_thousand_hostile_messages(site: Site) -> None:
    """With the token: nested, over-long, no JSON, not even a frame."""
    texts = ["[" * 60000, '{"a":' * 13000, "{", "[]", '{"op": "' + "x" * 60000 + '"}', "1" * 60000]

    async def attack(figures: Counter[str]) -> None:
        async with aiohttp.ClientSession() as http:
            async with http.ws_connect(site.ws) as ws:
                await ws.receive()
                for k in range(900):
                    await ws.send_str(texts[k % len(texts)])
                    async with asyncio.timeout(LIMIT_S):
                        while (message := await ws.receive()).type is not aiohttp.WSMsgType.TEXT:
                            assert message.type is aiohttp.WSMsgType.BINARY, message
                    figures["answered"] += json.loads(message.data)["op"] == "error"
            for _ in range(100):
                async with http.ws_connect(site.ws, autoping=False) as ws:
                    await ws.receive()
                    await ws.send_str("x" * 100_000)
                    async with asyncio.timeout(LIMIT_S):
                        while (message := await ws.receive()).type is aiohttp.WSMsgType.BINARY:
                            pass
                    figures["closed with 1009"] += ws.close_code == 1009

    figures = attacked(site, "hostile messages with the token", attack)
    assert figures["answered"] == 900 and figures["closed with 1009"] == 100


def test_the_figures_can_fail(site: Site) -> None:
    """An attack that costs too much is noticed: here, one that writes into the log."""

    async def attack(_: Any) -> None:
        with open(next(site.folder.glob("*.log")), "ab") as log:
            log.write(b"\n" * (LOG_BYTES + 1))

    with pytest.raises(AssertionError):
        attacked(site, "a log that grows", attack)
