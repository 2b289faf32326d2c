"""Answers the requests that come to the server: a WebSocket for each client, and one line for whom it is not there."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
from collections.abc import Sequence

from aiohttp import web

from evis.web import gate
from evis.web.guard import guard
from evis.web.server import CLOSE_S
from nodes.foxglove import protocol
from nodes.foxglove.origins import may_read
from nodes.foxglove.relay import Relay
from nodes.foxglove.session import Session

ALIVE_S = 120.0
"""Time after which a client is asked for a sign of life; it has half of that to answer [s], which a slow network takes
for the message that is on its way."""
LONGEST = 1 << 20
"""Longest message that is looked at; whoever sends a longer one is cut off at once, with code 1009."""
_WRONG_TOKEN = "403: this graph needs its token: ws://HOST:PORT/TOKEN\n"
_FOREIGN = "403: the graph is not served under that name; open it by its address\n"


class Application:
    """Answers for one graph: the WebSocket is `/`, or `/<token>` where there is one."""

    def __init__(self, relay: Relay, token: str, names: frozenset[str], origins: Sequence[str]) -> None:
        """token: "" = none is asked for. names: see address.names_of. origins: of pages that may read besides."""
        self._relay, self._token, self._origins = relay, token, origins
        self._ended = asyncio.Event()
        self._open: set[asyncio.Future[None]] = set()
        self.web = web.Application(middlewares=[guard(names, relay.count, _FOREIGN, _WRONG_TOKEN)])
        self.web.router.add_get("/{token:[^/]*}", self._socket)

    async def hang_up(self) -> None:
        """Tells all clients that the run has ended, and waits for their answers."""
        self._ended.set()
        if self._open:
            await asyncio.wait(self._open, timeout=CLOSE_S)

    def _admit(self, request: web.Request) -> None:
        """Lets in who may read. Raises HTTPForbidden, or HTTPBadRequest where no client of the protocol asks."""
        if not hmac.compare_digest(request.match_info["token"].encode(errors="replace"), self._token.encode()):
            raise web.HTTPForbidden(text=_WRONG_TOKEN)
        origins = request.headers.getall("Origin", [])
        if not may_read(origins, self._origins):
            shown = "".join(letter if "!" <= letter <= "~" else "?" for letter in origins[0])[:100]
            self._relay.report(f"a page of {shown} was refused; origins:={shown} lets it read the graph")
            raise web.HTTPForbidden(text="403: pages of this origin may not read the graph\n")
        offered = {
            word.strip() for line in request.headers.getall("Sec-WebSocket-Protocol", []) for word in line.split(",")
        }
        if not offered & set(protocol.SUBPROTOCOLS):
            raise web.HTTPBadRequest(text=f"400: a WebSocket of {' or '.join(protocol.SUBPROTOCOLS)} is served here\n")
        gate.admit(request)

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        """Serves one client, until it goes away or the run has ended."""
        self._admit(request)
        ws = web.WebSocketResponse(
            heartbeat=ALIVE_S, max_msg_size=LONGEST, compress=False, timeout=CLOSE_S, protocols=protocol.SUBPROTOCOLS
        )
        await ws.prepare(request)
        served: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._open.add(served)
        session = Session(self._relay, ws)
        running = asyncio.create_task(session.run())
        ended = asyncio.create_task(self._ended.wait())
        try:
            await asyncio.wait((running, ended), return_when=asyncio.FIRST_COMPLETED)
            if running.done():
                running.result()  # raises what it ended with
            else:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(session.sent_all(), CLOSE_S / 2)
                running.cancel()  # it would read the answer to the goodbye
                await asyncio.wait((running,))
                with contextlib.suppress(ConnectionError, RuntimeError):  # the client has gone meanwhile
                    await self._say_goodbye(ws)
        finally:
            self._open.discard(served)
            served.set_result(None)
            running.cancel()
            ended.cancel()
            await asyncio.gather(running, ended, return_exceptions=True)
        return ws

    async def _say_goodbye(self, ws: web.WebSocketResponse) -> None:
        """Says why no more comes, as a status too: Foxglove shows that, and tries again for ever."""
        await ws.send_str(self._relay.goodbye())
        await ws.close(code=1001, message=b"no more comes")
