"""Serves the page on a thread of its own: static files, and one WebSocket per open page.

Flow control is one credit per client: the page acknowledges a bundle after drawing it, and only then gets the next,
made of the newest of each panel at that moment. A slow or dead browser costs at most one bundle of memory. Who may
connect at all is gate.py's; what is refused is answered in one line, counted, and not logged one by one.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import socket
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from urllib.parse import urlsplit

from aiohttp import web

from nodes.visualizer import address, gate
from nodes.visualizer.hub import Hub
from nodes.visualizer.session import MOST_BYTES, Session
from nodes.visualizer.weblog import WebLog

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
KEPT_S = 15.0
"""How long a connection with the token is kept between two requests [s]."""
HANG_UP: web.AppKey[Callable[[], Awaitable[None]]] = web.AppKey("hang_up")
"""Tells all pages that the run has ended, and waits for their answers."""
CLOSE_S = 0.6
"""Time that open connections get to say goodbye; only a browser that is slow to answer takes it."""


def make_app(hub: Hub, token: str, names: frozenset[str], max_fps: float) -> web.Application:
    """Makes the application: `/?token=...` is the page, all else lies under `/<token>/`. names: see names_of."""
    pages = {e.name: e.read_bytes() for e in files("nodes.visualizer").joinpath("page").iterdir() if e.is_file()}
    encoder = ThreadPoolExecutor(1, thread_name_prefix="viewer-encode")
    over = asyncio.Event()
    open_pages: set[asyncio.Future[None]] = set()

    def admit(request: web.Request, given: str | None) -> None:
        shown = (given or "").encode(errors="replace")
        if not hmac.compare_digest(shown, token.encode()):
            raise web.HTTPForbidden(text=_REFUSAL)
        gate.admit(request)

    @web.middleware
    async def guard(
        request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        try:
            reached = request.transport.get_extra_info("sockname") if request.transport is not None else None
            if not address.is_served(request.headers.getall("Host", []), names, str((reached or [""])[0])):
                raise web.HTTPForbidden(text=_FOREIGN)
            if request.match_info.http_exception is not None:
                raise web.HTTPForbidden(text=_REFUSAL)  # there is nothing of that name, which strangers need not know
            return await handler(request)
        except web.HTTPException as refusal:
            hub.count(gate.REFUSED)
            refusal.force_close()
            raise

    async def index(request: web.Request) -> web.Response:
        admit(request, request.query.get("token"))
        body = pages["index.html"].replace(b"{base}", f"/{token}/".encode())
        return web.Response(body=body, content_type="text/html", charset="utf-8", headers=_HEADERS)

    async def asset(request: web.Request) -> web.Response:
        admit(request, request.match_info["token"])
        name = request.match_info["name"]
        if name not in pages:
            raise web.HTTPNotFound(text=f"404: there is no {name}\n")
        kind = _TYPES.get("." + name.rpartition(".")[2], "application/octet-stream")
        return web.Response(body=pages[name], content_type=kind, charset="utf-8", headers=_HEADERS)

    async def connect(request: web.Request) -> web.WebSocketResponse:
        admit(request, request.match_info["token"])
        if not _same_site(request.headers.getall("Origin", []), request.host):
            raise web.HTTPForbidden(text="403: another site's page may not connect\n")
        ws = web.WebSocketResponse(heartbeat=10, max_msg_size=MOST_BYTES, compress=False, timeout=CLOSE_S)
        await ws.prepare(request)
        page: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        open_pages.add(page)
        session = asyncio.create_task(Session(hub, ws, encoder, max_fps).run())
        told = asyncio.create_task(over.wait())
        try:
            await asyncio.wait((session, told), return_when=asyncio.FIRST_COMPLETED)
            if session.done():
                session.result()  # raises what it ended with
            else:
                # Only where nobody else reads does the server wait for the page's answer: a socket that is closed
                # before what a page has sent is read takes its last messages from it.
                session.cancel()
                await asyncio.wait((session,))
                with contextlib.suppress(ConnectionError):  # the page has gone meanwhile
                    await _goodbye(ws)
        finally:
            open_pages.discard(page)
            page.set_result(None)
            session.cancel()
            told.cancel()
            await asyncio.gather(session, told, return_exceptions=True)
        return ws

    async def hang_up() -> None:
        over.set()
        if open_pages:
            await asyncio.wait(open_pages, timeout=CLOSE_S)

    async def end(app: web.Application) -> None:
        encoder.shutdown(wait=False, cancel_futures=True)

    app = web.Application(middlewares=[guard])
    app.router.add_get("/", index)
    app.router.add_get("/{token}/ws", connect)
    app.router.add_get("/{token}/{name}", asset)
    app[HANG_UP] = hang_up
    app.on_cleanup.append(end)
    return app


def _same_site(origins: list[str], host: str) -> bool:
    """Whether a page of this server's asks, or a program that is no browser and says no origin."""
    try:
        return all(urlsplit(origin).netloc == host for origin in origins)
    except ValueError:
        return False


async def _goodbye(ws: web.WebSocketResponse) -> None:
    """Say that the run has ended, as a message too: a closing handshake that is cut off loses its code."""
    await ws.send_json({"op": "end"})
    await ws.close(code=1001, message=b"the graph has ended")


class Server:
    """Runs the application on its own thread and event loop.

    hub: what the page shows. listener: bound socket. token, names: who gets in, see address.py. max_fps: most bundles
    per second to each browser [Hz].
    """

    def __init__(self, hub: Hub, listener: socket.socket, token: str, names: frozenset[str], max_fps: float) -> None:
        self._app = make_app(hub, token, names, max_fps)
        self._hub = hub
        self._log = WebLog(hub.report, lambda: hub.count(gate.REFUSED))
        self.gate: gate.Gate | None = None
        self._listener = listener
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._main, name="viewer", daemon=True)

    def start(self) -> None:
        """Starts to serve; returns when connections are accepted."""
        self._thread.start()
        self._ready.wait(10)

    def stop(self) -> None:
        """Closes every connection and ends the thread: at once, or within CLOSE_S when a browser does not answer."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(CLOSE_S + 0.3)

    def _main(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.set_exception_handler(self._log.fault)
        try:
            with self._log.listening():
                self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        runner = web.AppRunner(
            self._app, access_log=None, logger=self._log.logger, keepalive_timeout=KEPT_S, shutdown_timeout=CLOSE_S,
            handle_signals=False,
        )  # fmt: skip
        await runner.setup()
        assert runner.server is not None
        self.gate = gate.Gate(runner.server, self._hub.count)
        doorman = asyncio.create_task(self.gate.serve(self._listener))
        try:
            self._ready.set()
            await self._stop.wait()
        finally:
            doorman.cancel()
            await asyncio.gather(doorman, return_exceptions=True)
            self._listener.close()
            await self._app[HANG_UP]()  # before aiohttp shuts down, which reads no answers any more
            await runner.cleanup()
