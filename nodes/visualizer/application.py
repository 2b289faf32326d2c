"""Answers the requests that come to the page's server: static files, and one WebSocket per open page.

What is refused is answered in one line and counted.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from urllib.parse import urlsplit

from aiohttp import web

from evis.web import gate
from evis.web.guard import guard
from evis.web.server import CLOSE_S
from nodes.visualizer.hub import Hub
from nodes.visualizer.session import MOST_BYTES, Session

_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
    "frame-ancestors 'none'",
}
_REFUSAL = "403: this page needs its token; use the whole address that the graph printed, or run `evis view`\n"
_FOREIGN = "403: this page is not served under that name; open it by its address, or give the visualizer names:=NAME\n"
ALIVE_S = 120.0
"""Time after which a page is asked for a sign of life; it has half of that to answer [s]. The answer comes after the
bundle that is on its way, which takes a slow network long: a page that gets one a minute is slow, not gone."""


class Application:
    """Answers the requests for one page: `/?token=...` is the page, all else lies under `/<token>/`."""

    def __init__(self, hub: Hub, token: str, names: frozenset[str], max_fps: float) -> None:
        """Reads the page's files. names: see address.names_of. max_fps: most bundles a second to each browser [Hz]."""
        self._hub, self._token, self._max_fps = hub, token, max_fps
        folder = files("nodes.visualizer").joinpath("page")
        self._files = {entry.name: entry.read_bytes() for entry in folder.iterdir() if entry.is_file()}
        self._encoder = ThreadPoolExecutor(1, thread_name_prefix="viewer-encode")
        self._ended = asyncio.Event()
        self._open_pages: set[asyncio.Future[None]] = set()
        self.web = web.Application(middlewares=[guard(names, hub.count, _FOREIGN, _REFUSAL)])
        self.web.router.add_get("/", self._page)
        self.web.router.add_get("/{token}/ws", self._socket)
        self.web.router.add_get("/{token}/{name}", self._file)
        self.web.on_cleanup.append(self._clean_up)

    async def hang_up(self) -> None:
        """Tells all pages that the run has ended, and waits for their answers."""
        self._ended.set()
        if self._open_pages:
            await asyncio.wait(self._open_pages, timeout=CLOSE_S)

    async def _clean_up(self, app: web.Application) -> None:
        self._encoder.shutdown(wait=False, cancel_futures=True)

    def _admit(self, request: web.Request, given: str | None) -> None:
        """Lets a request with the right token in. Raises HTTPForbidden for another one."""
        shown = (given or "").encode(errors="replace")
        if not hmac.compare_digest(shown, self._token.encode()):
            raise web.HTTPForbidden(text=_REFUSAL)
        gate.admit(request)

    async def _page(self, request: web.Request) -> web.Response:
        self._admit(request, request.query.get("token"))
        body = self._files["index.html"].replace(b"{base}", f"/{self._token}/".encode())
        return web.Response(body=body, content_type="text/html", charset="utf-8", headers=_HEADERS)

    async def _file(self, request: web.Request) -> web.Response:
        self._admit(request, request.match_info["token"])
        name = request.match_info["name"]
        if name not in self._files:
            raise web.HTTPNotFound(text=f"404: there is no {name}\n")
        kind = _TYPES.get("." + name.rpartition(".")[2], "application/octet-stream")
        return web.Response(body=self._files[name], content_type=kind, charset="utf-8", headers=_HEADERS)

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        """Serves the WebSocket of one open page, until the page goes away or the run has ended."""
        self._admit(request, request.match_info["token"])
        if not _same_site(request.headers.getall("Origin", []), request.host):
            raise web.HTTPForbidden(text="403: another site's page may not connect\n")
        ws = web.WebSocketResponse(heartbeat=ALIVE_S, max_msg_size=MOST_BYTES, compress=False, timeout=CLOSE_S)
        await ws.prepare(request)
        page: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._open_pages.add(page)
        session = asyncio.create_task(Session(self._hub, ws, self._encoder, self._max_fps).run())
        ended = asyncio.create_task(self._ended.wait())
        try:
            await asyncio.wait((session, ended), return_when=asyncio.FIRST_COMPLETED)
            if session.done():
                session.result()  # raises what it ended with
            else:
                # Only where nobody else reads does the server wait for the page's answer: a socket that is closed
                # before what a page has sent is read takes its last messages from it.
                session.cancel()
                await asyncio.wait((session,))
                with contextlib.suppress(ConnectionError):  # the page has gone meanwhile
                    await _goodbye(ws, self._hub.failure)
        finally:
            self._open_pages.discard(page)
            page.set_result(None)
            session.cancel()
            ended.cancel()
            await asyncio.gather(session, ended, return_exceptions=True)
        return ws


def _same_site(origins: list[str], host: str) -> bool:
    """Tells whether a page of this server's asks, or a program that is no browser and says no origin."""
    try:
        return all(urlsplit(origin).netloc == host for origin in origins)
    except ValueError:
        return False


async def _goodbye(ws: web.WebSocketResponse, failure: str) -> None:
    """Says that the run has ended, and by what failure, if any, as a message too: a closing handshake that is cut off
    loses its code.
    """
    await ws.send_json({"op": "end", "failure": failure})
    await ws.close(code=1001, message=b"the graph has ended")
