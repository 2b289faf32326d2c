"""Sends taps of a topic their copies: a limited number a second, and only while one listens.

A full queue drops, here or at the listener; sequence numbers tell it how much it missed.
"""

from __future__ import annotations

import math
import time

import zmq

from evis.bus import wire
from evis.bus.endpoints import bind
from msgs.codec import Buffer
from msgs.topics import UnknownTopic, find_topic


def queue_length(topic: str) -> int:
    """Returns how many messages a tap may lag behind, from the topic table; 2 for a name that is not in it."""
    try:
        return max(2, find_topic(topic).queue)  # at 1, libzmq never lets a first message through to a late subscriber
    except UnknownTopic:
        return 2


END_WAIT_S = 0.2


class TapSender:
    """Sends the lossy copy of one topic.

    hz: most messages per second, 0 = all; the ones between are skipped and counted, unless a listener wants every one.
    """

    def __init__(self, topic: str, hz: float) -> None:
        self.topic = topic.encode()
        self.listeners = 0
        self.eager = 0
        """Listeners that want every message."""
        self.sent = 0
        self.skipped = 0
        self.rejected = 0
        self.latched: list[Buffer] | None = None
        """Last value of a latched topic, given to each newcomer."""
        self._interval = 1.0 / hz if hz > 0 else 0.0
        self._next = -math.inf  # of a clock that starts anywhere: 0 would be late or far ahead by the machine's uptime

    def open(self, sock: zmq.Socket, address: str) -> None:
        """Binds the socket that it sends through."""
        self.socket = sock
        bind(sock, address)

    def handle_xpub(self, frames: list[bytes]) -> None:
        """Handles a message of the XPUB socket: a listener has come or gone."""
        key = frames[0][1:]
        if len(frames) != 1 or frames[0][:1] not in (b"\0", b"\1"):
            self.rejected += 1
        elif key == self.topic:
            self.listeners = max(0, self.listeners + (1 if frames[0][0] else -1))
        elif key == wire.EVERY:
            self.eager = max(0, self.eager + (1 if frames[0][0] else -1))
        elif not key.startswith(b"!"):
            self.rejected += 1
        elif frames[0][0] and self.latched:
            wire.send(self.socket, [key, *self.latched])

    def ready(self) -> bool:
        """Tells whether the next message would be sent; counts nothing."""
        return self.listeners > 0 and (self.eager > 0 or time.monotonic() >= self._next)

    def due(self) -> bool:
        """Tells whether a tap listens and the rate limit lets the next message through; counts it if not."""
        if not self.listeners:
            return False
        now = time.monotonic()
        if now < self._next and not self.eager:
            self.skipped += 1
            return False
        # Keep to the grid while messages come steadily; start a new one after a pause.
        self._next = max(self._next + self._interval, now)
        return True

    def send(self, frames: list[Buffer]) -> None:
        """Copies a message into the socket's queue; never waits."""
        if self.eager:
            # Otherwise libzmq looks at what the readers have taken only now and then, and drops by what it knew before.
            self.socket.getsockopt(zmq.EVENTS)
        wire.send(self.socket, [self.topic, *frames])
        self.sent += 1

    def end(self, frames: list[Buffer]) -> None:
        """Sends the one message that a full queue must not swallow; waits END_WAIT_S for a slow listener."""
        if not self.listeners:
            return
        self.socket.setsockopt(zmq.XPUB_NODROP, 1)
        deadline = time.monotonic() + END_WAIT_S
        while not self._send_now([self.topic, *frames]):
            if time.monotonic() > deadline:
                self.socket.setsockopt(zmq.XPUB_NODROP, 0)
            else:
                time.sleep(0.005)

    def _send_now(self, frames: list[Buffer]) -> bool:
        try:
            self.socket.send_multipart(frames, zmq.NOBLOCK)
        except zmq.Again:
            return False
        return True
