"""Connects an outside program with a node of a running graph: packets of frames over a Unix socket, both ways.

A Unix socket tells at once, and for certain, that the other side has gone, however it ended: whoever controls a robot
must not be missed for seconds. Neither side ever waits for the other inside these calls, but for `send` as long as it
is told to.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import time
from collections.abc import Sequence
from pathlib import Path

from msgs.codec import Buffer

MOST_BYTES = 1 << 26
"""Longest packet [bytes]: actions of some hundred thousand environments."""
MOST_FRAMES = 8
_READ = 1 << 16
_HEAD = struct.Struct("<I")
_CREDENTIALS = struct.Struct("3i")


class LinkLost(ConnectionError):
    """Reports that the other side has gone, or sends invalid packets."""


class Link:
    """Holds one end of a connection. `peer`: process id of the other side, 0 where the system does not tell."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        self._socket = sock
        self._received = bytearray()
        self.peer = _peer_of(sock)

    def fileno(self) -> int:
        """Returns the file descriptor, for a poller; -1 after `close`."""
        return self._socket.fileno()

    def send(self, frames: Sequence[Buffer], timeout_s: float = 0.0) -> None:
        """Sends one packet. Raises LinkLost when the other side has gone, or takes nothing for `timeout_s`.

        What it had sent before can still be received then, and ends behind that.
        """
        sizes = [len(frame) for frame in frames]
        packet = b"".join([_HEAD.pack(len(frames)), *map(_HEAD.pack, sizes), *frames])
        rest = memoryview(packet)
        deadline = time.monotonic() + timeout_s
        while rest:
            try:
                rest = rest[self._socket.send(rest) :]
            except BlockingIOError:
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    raise self._lost(f"the other side has read nothing for {timeout_s:g} s") from None
                select.select((), (self._socket,), (), left_s)
            except OSError as error:
                raise self._lost(error.strerror or str(error)) from None

    def _lost(self, why: str) -> LinkLost:
        with contextlib.suppress(OSError):  # the other side has gone
            self._socket.shutdown(socket.SHUT_RDWR)
        return LinkLost(why)

    def receive(self, timeout_s: float = 0.0) -> list[bytes] | None:
        """Returns the frames of the next packet, None when none has come within `timeout_s`. Raises LinkLost."""
        deadline = time.monotonic() + timeout_s
        while (packet := self._packet()) is None:
            left_s = max(0.0, deadline - time.monotonic())
            if not select.select((self._socket,), (), (), left_s)[0]:
                return None
            try:
                data = self._socket.recv(_READ)
            except BlockingIOError:
                continue
            except OSError as error:
                raise LinkLost(error.strerror or str(error)) from None
            if not data:
                raise LinkLost("the other side has closed the connection")
            self._received += data
        return packet

    def _packet(self) -> list[bytes] | None:
        data = self._received
        if len(data) < _HEAD.size:
            return None
        (count,) = _HEAD.unpack_from(data)
        if not 1 <= count <= MOST_FRAMES:
            raise LinkLost(f"a packet of {count} frames")
        start = _HEAD.size * (1 + count)
        if len(data) < start:
            return None
        sizes = [_HEAD.unpack_from(data, _HEAD.size * (1 + k))[0] for k in range(count)]
        if sum(sizes) > MOST_BYTES:
            raise LinkLost(f"a packet of {sum(sizes)} bytes, the limit is {MOST_BYTES}")
        if len(data) < start + sum(sizes):
            return None
        frames = []
        for size in sizes:
            frames.append(bytes(data[start : start + size]))
            start += size
        del data[:start]
        return frames

    def close(self) -> None:
        """Ends the connection."""
        self._socket.close()


class Listener:
    """Accepts connections at a path in a directory of the user's own."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.setblocking(False)
        # Who sees the path can connect: a socket that is bound and does not listen yet refuses.
        bound = str(path)[:-1] + "~"
        self._socket.bind(bound)
        try:
            self._socket.listen()
            os.link(bound, path)
        finally:
            os.unlink(bound)

    def fileno(self) -> int:
        """Returns the file descriptor, for a poller."""
        return self._socket.fileno()

    def accept(self) -> Link | None:
        """Returns the next connection, None when none is waiting."""
        try:
            return Link(self._socket.accept()[0])
        except OSError:
            return None

    def close(self) -> None:
        """Stops listening."""
        self._socket.close()
        with contextlib.suppress(OSError):
            os.unlink(self.path)


def connect(path: Path) -> Link:
    """Connects to a Listener. Raises OSError when there is none."""
    sock = socket.socket(socket.AF_UNIX)
    try:
        sock.connect(str(path))
    except OSError:
        sock.close()
        raise
    return Link(sock)


def _peer_of(sock: socket.socket) -> int:
    if not hasattr(socket, "SO_PEERCRED"):
        return 0
    pid: int = _CREDENTIALS.unpack(sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))[0]
    return pid
