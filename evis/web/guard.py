"""Refuses requests that name another server or a place that is not there, in one line each, and counts them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from aiohttp import web
from aiohttp.typedefs import Middleware

from evis.web import address, gate

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def guard(names: frozenset[str], count: Callable[[str], None], foreign: str, nowhere: str) -> Middleware:
    """Makes the middleware of an application.

    names: see address.names_of. count: takes the name of a counter. foreign, nowhere: what is answered to a request
    under another name, as a page has it that leads its own name here (DNS rebinding), and to one for a place that there
    is not, which strangers need not know from one that takes a token.
    """

    @web.middleware
    async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            reached = request.transport.get_extra_info("sockname") if request.transport is not None else None
            if not address.is_served(request.headers.getall("Host", []), names, str((reached or [""])[0])):
                raise web.HTTPForbidden(text=foreign)
            if request.match_info.http_exception is not None:
                raise web.HTTPForbidden(text=nowhere)
            return await handler(request)
        except web.HTTPException as refusal:
            count(gate.REFUSED)
            refusal.force_close()
            raise

    return guarded
