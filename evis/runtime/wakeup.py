"""Ends the executor's wait when a socket is readable that it would read."""

from __future__ import annotations

from collections.abc import Sequence

import zmq


class Wakeup:
    """Polls the sockets of several owners, which change: what nobody would read must not end the wait."""

    def __init__(self) -> None:
        self._poller = zmq.Poller()
        self._heard: dict[object, Sequence[zmq.Socket | int]] = {}

    def hear(self, owner: object, sockets: Sequence[zmq.Socket | int]) -> None:
        """Sets the sockets of `owner` that end the wait from now on, in place of those before."""
        before = self._heard.get(owner, ())
        if sockets == before:
            return
        for socket in before:
            if socket not in sockets:
                self._poller.unregister(socket)
        for socket in sockets:
            self._poller.register(socket, zmq.POLLIN)
        self._heard[owner] = sockets

    def forget(self, owner: object) -> None:
        """Stops polling the sockets of `owner`, which is about to close them."""
        self.hear(owner, [])
        self._heard.pop(owner, None)

    def wait(self, timeout_ms: int) -> None:
        """Waits until a socket is readable, at most this long."""
        self._poller.poll(timeout_ms)
