"""Runs an application's HTTP server on a thread of its own, so that nothing it does holds up the node.

Who may connect at all is gate.py's; what is refused is answered in one line, counted, and not logged one by one.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from typing import Protocol

from aiohttp import web

from evis.web import gate
from evis.web.notices import Notices
from evis.web.weblog import WebLog

KEPT_S = 15.0
"""How long a connection with the token is kept between two requests [s]."""
CLOSE_S = 0.6
"""Time that open connections get to say goodbye; only who is slow to answer takes it."""


class Application(Protocol):
    """Answers the requests."""

    web: web.Application

    async def hang_up(self) -> None:
        """Tells all who are connected that the run has ended, and waits for their answers, CLOSE_S at the most."""


class Server:
    """Runs an application on its own thread and event loop. listener: bound socket. notices: counts and reports."""

    def __init__(self, application: Application, notices: Notices, listener: socket.socket) -> None:
        self._app = application
        self._notices = notices
        self._log = WebLog(notices.report, lambda: notices.count(gate.REFUSED))
        self.gate: gate.Gate | None = None
        self._listener = listener
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._main, name="web-server", daemon=True)

    def start(self) -> None:
        """Starts to serve; returns when connections are accepted."""
        self._thread.start()
        self._ready.wait(10)

    def stop(self) -> None:
        """Closes every connection and ends the thread: at once, or within CLOSE_S when somebody does not answer."""
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
        self.gate = gate.Gate(runner.server, self._notices.count)
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
