"""Serves the page on a thread of its own; what it answers is in application.py.

Flow control is one credit per client: the page acknowledges a bundle after drawing it, and only then gets the next,
made of the newest of each panel at that moment. A slow or dead browser costs at most one bundle of memory. Who may
connect at all is gate.py's; what is refused is answered in one line, counted, and not logged one by one.
"""

from __future__ import annotations

import asyncio
import socket
import threading

from aiohttp import web

from nodes.visualizer import gate
from nodes.visualizer.application import CLOSE_S, Application
from nodes.visualizer.hub import Hub
from nodes.visualizer.weblog import WebLog

KEPT_S = 15.0
"""How long a connection with the token is kept between two requests [s]."""


class Server:
    """Runs the application on its own thread and event loop.

    hub: what the page shows. listener: bound socket. token, names: who gets in, see address.py. max_fps: most bundles
    per second to each browser [Hz].
    """

    def __init__(self, hub: Hub, listener: socket.socket, token: str, names: frozenset[str], max_fps: float) -> None:
        self._app = Application(hub, token, names, max_fps)
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
            self._app.web, access_log=None, logger=self._log.logger, keepalive_timeout=KEPT_S, shutdown_timeout=CLOSE_S,
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
            await self._app.hang_up()  # before aiohttp shuts down, which reads no answers any more
            await runner.cleanup()
