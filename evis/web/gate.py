"""Limits the connections: those without the token are few and short, and those with it are not too many.

A connection is a stranger until one of its requests has shown the token. A stranger has HEAD_S for that and may send
HEAD_BYTES; where there are too many strangers the oldest goes. No more are taken than STRANGERS per GRACE_S, the others
wait in the system's queue, so that however many come, each has GRACE_S (less what comes at once), which is plenty for
one who knows the token.
"""

from __future__ import annotations

import asyncio
import errno
import resource
import socket
from collections.abc import Callable

from aiohttp import web

HEAD_S = 5.0
"""Time that a connection has from its opening until it has shown the token [s]."""
HEAD_BYTES = 1 << 15
"""Most that it may send until then."""
STRANGERS = 256
FRIENDS = 600
"""Most connections without and with the token, where the limit of open files allows so many."""
GRACE_S = 1.0
AT_ONCE = 64
"""Connections that are taken without a wait, as a page opens several."""
REST_S = 0.5
"""Wait after the system has refused to hand a connection over (too many open files) [s]."""
WAITING = 512
"""Connections that the system holds until they are taken."""
REFUSED, DROPPED = "requests_refused", "connections_dropped"
"""Counters of the node."""


class Gate:
    """Keeps the connections of a server. `inner` makes what answers each; `count` takes the name of a counter."""

    def __init__(self, inner: Callable[[], asyncio.Protocol], count: Callable[[str], None]) -> None:
        files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        self.most_strangers = min(STRANGERS, max(files // 4, 1))
        self.most_friends = min(FRIENDS, max(files // 2, 1))
        self.count = count
        self.strangers: dict[Connection, None] = {}
        """The oldest first."""
        self.friends: set[Connection] = set()
        self._inner = inner

    async def serve(self, listener: socket.socket) -> None:
        """Takes connections until cancelled."""
        loop = asyncio.get_running_loop()
        listener.setblocking(False)
        listener.listen(WAITING)
        each = GRACE_S / self.most_strangers
        due = loop.time()
        while True:
            try:
                taken, _ = await loop.sock_accept(listener)
                await loop.connect_accepted_socket(lambda: Connection(self, self._inner()), taken)
            except OSError as error:
                if error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                    self.count(DROPPED)
                    await asyncio.sleep(REST_S)
            due = max(due, loop.time() - AT_ONCE * each) + each
            await asyncio.sleep(due - loop.time())

    def enter(self, connection: Connection) -> None:
        """Notes that a connection was opened; the oldest stranger goes where there are too many."""
        self.strangers[connection] = None
        if len(self.strangers) > self.most_strangers:
            next(iter(self.strangers)).drop()

    def leave(self, connection: Connection) -> None:
        """Notes that a connection is closed, or will be in this turn."""
        self.strangers.pop(connection, None)
        self.friends.discard(connection)


class Connection(asyncio.Protocol):
    """Hands on what comes over one connection to the protocol behind it, as long as it may stay."""

    def __init__(self, gate: Gate, inner: asyncio.Protocol) -> None:
        self._gate = gate
        self._inner = inner
        self._transport: asyncio.Transport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._received = 0

    def admit(self) -> bool:
        """Admits a connection that has shown the token. False where there are too many such connections."""
        if self in self._gate.friends:
            return True
        if len(self._gate.friends) >= self._gate.most_friends:
            return False
        self._gate.leave(self)
        self._gate.friends.add(self)
        if self._timer is not None:
            self._timer.cancel()
        return True

    def drop(self) -> None:
        """Closes it at once, whatever was on its way."""
        self._gate.leave(self)
        self._gate.count(DROPPED)
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._timer = asyncio.get_running_loop().call_later(HEAD_S, self.drop)
        self._inner.connection_made(transport)
        self._gate.enter(self)

    def data_received(self, data: bytes) -> None:
        if self in self._gate.strangers:
            self._received += len(data)
            if self._received > HEAD_BYTES:
                self.drop()
                return
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        return self._inner.eof_received()

    def pause_writing(self) -> None:
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        self._inner.resume_writing()

    def connection_lost(self, error: Exception | None) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._gate.leave(self)
        self._inner.connection_lost(error)


def admit(request: web.Request) -> None:
    """Lets the connection of a request that has shown the token stay.

    Raises HTTPServiceUnavailable where too many do.
    """
    connection = request.transport.get_protocol() if request.transport is not None else None
    if isinstance(connection, Connection) and not connection.admit():
        raise web.HTTPServiceUnavailable(text="503: too many connections are open; close some\n")
