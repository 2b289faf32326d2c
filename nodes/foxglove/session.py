"""Speaks the protocol with one client, as long as its WebSocket lives."""

from __future__ import annotations

import asyncio
import contextlib
import time

from aiohttp import WSMsgType, web

from evis.web.gate import REFUSED
from nodes.foxglove import protocol
from nodes.foxglove.channels import Frame
from nodes.foxglove.client import Client
from nodes.foxglove.relay import Relay

MOST_FAULTS = 20
"""Messages that nothing can be done with until a client is cut off."""
TOLD_S = 60.0
"""Interval at which a client is told what it did not get [s]."""
TOO_MANY = 1008
"""Code with which a client is cut off (RFC 6455, policy violation)."""


class TooManyFaults(Exception):
    """Says that a client is not worth listening to any more."""


class Session:
    """Serves one client. It gets the newest of each subscription, one after the other, as fast as it takes them."""

    def __init__(self, relay: Relay, ws: web.WebSocketResponse) -> None:
        self._relay, self._ws = relay, ws
        self._news = asyncio.Event()
        self._drained = asyncio.Event()
        self._faults = 0
        self._time_ns = -1
        self._tells_at = time.monotonic() + TOLD_S
        loop = asyncio.get_running_loop()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody is left to be woken
                loop.call_soon_threadsafe(self._news.set)

        self._client = Client(wake)

    async def run(self) -> None:
        """Serves until the client goes away, or is cut off."""
        plan, tasks = self._relay.plan, []
        try:
            await self._ws.send_str(protocol.server_info(f"EVIS {plan.name}", plan.run_id, self._relay.describe()))
            self._relay.join(self._client)
            tasks = [asyncio.create_task(self._read()), asyncio.create_task(self._write())]
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()  # raises what it ended with
        except TooManyFaults:
            await self._ws.close(code=TOO_MANY, message=b"too many messages that mean nothing here")
        except ConnectionError:
            pass
        finally:
            self._relay.leave(self._client)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def sent_all(self) -> None:
        """Waits until nothing waits for the client any more."""
        self._drained.clear()
        self._news.set()
        await self._drained.wait()

    async def _read(self) -> None:
        async for message in self._ws:
            if message.type is WSMsgType.TEXT:
                await self._hear(message.data)
            elif message.type is WSMsgType.BINARY:
                await self._refuse("a binary message came; clients cannot publish here")

    async def _hear(self, text: str) -> None:
        try:
            op, entries = protocol.parse(text)
        except ValueError as error:
            await self._refuse(str(error))
            return
        for entry in entries:
            try:
                if op == "subscribe":
                    self._relay.subscribe(self._client, *protocol.subscription(entry))
                else:
                    self._relay.unsubscribe(self._client, protocol.number(entry, "subscription id"))
            except ValueError as error:
                await self._refuse(str(error))

    async def _refuse(self, text: str) -> None:
        """Answers what nothing can be done with. Raises TooManyFaults at the last one that is borne."""
        self._relay.count(REFUSED)
        self._faults += 1
        await self._ws.send_str(protocol.status(protocol.ERROR, text))
        if self._faults >= MOST_FAULTS:
            raise TooManyFaults

    async def _write(self) -> None:
        with contextlib.suppress(ConnectionError, RuntimeError):  # the client has gone
            while True:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._news.wait(), max(self._tells_at - time.monotonic(), 0.001))
                self._news.clear()
                await self._tell_losses()
                while (waiting := self._client.take()) is not None:
                    if isinstance(waiting, str):
                        await self._ws.send_str(waiting)
                    else:
                        await self._send(*waiting)
                        await self._tell_losses()  # of who is slow something waits always
                self._drained.set()

    async def _send(self, subscription: int, frames: list[Frame]) -> None:
        newest = self._relay.newest_ns
        if newest != self._time_ns:
            self._time_ns = newest
            await self._ws.send_bytes(protocol.time_message(newest))
        for frame in frames:
            await self._ws.send_bytes(protocol.message_data(subscription, *frame))

    async def _tell_losses(self) -> None:
        if time.monotonic() < self._tells_at:
            return
        self._tells_at = time.monotonic() + TOLD_S
        left_out, missed = self._client.losses()
        told = []
        if left_out:
            told.append(f"{left_out} messages were left out, for this connection was not ready for them")
        if missed:
            told.append(f"{missed} came faster than they are read here (30 a second of a topic, of events 250)")
        if told:
            await self._ws.send_str(protocol.status(protocol.WARNING, f"in {TOLD_S:g} s {'; '.join(told)}"))
