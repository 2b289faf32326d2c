"""Sends messages to consumers, and credits back to publishers, through pipes between processes of one machine.

ZeroMQ wakes an I/O thread on either side for whatever is sent, which costs more than writing a megabyte of pixels. A
pipe costs one `write` and one `read`. Each side makes the pipe that it reads from; the other opens it through
/proc/<pid>/fd, as it opens shared memory. Neither pipe can overflow without being noticed: credits bound the messages,
and a credit that finds the pipe full goes over the socket.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import stat
import struct
from collections.abc import Container, Sequence

from evis.bus.wire import Malformed
from msgs.codec import Buffer

PAGE = 4096
"""Unit of a pipe's capacity [bytes]; a write that does not fit into the last page begins a new one."""
PAGES_PER_MESSAGE = 8
LARGEST = 1 << 20
"""Largest capacity that any user may give a pipe, unless the system's pipe-max-size was changed [bytes]."""
LONGEST = 1 << 20
"""Longest record [bytes]; no pipe holds more."""
_HEAD = struct.Struct("<II")
"""Bytes of the record, this included; number of frames."""
_CREDIT = struct.Struct("<I4sQ")
"""Link, operation (one letter and three zeros), sequence number. Short enough that a write is never torn."""
_ZEROS = bytes(3)
ELSEWHERE = _HEAD.pack(_HEAD.size, 0)
"""The record that stands for a message sent over the socket, so that the order is known."""


def pack(frames: Sequence[Buffer]) -> bytes:
    """Packs the record of a message."""
    count = len(frames)
    return b"".join((struct.pack(f"<{count + 2}I", packed_size(frames), count, *map(len, frames)), *frames))


def packed_size(frames: Sequence[Buffer]) -> int:
    """Returns the size of `pack(frames)` [bytes]."""
    return _HEAD.size + 4 * len(frames) + sum(map(len, frames))


class Inbox:
    """Reads from a pipe into which another process writes, which finds it by `address`."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        self._poll = select.poll()
        self._poll.register(self._read, select.POLLIN)
        self._rest = b""

    def fileno(self) -> int:
        """Returns the pipe's file descriptor, for a poller."""
        return self._read

    def wait(self, timeout_ms: float) -> bool:
        """Waits at most this long, and tells whether there is something to read."""
        return bool(self._poll.poll(timeout_ms))

    def fill(self) -> int:
        """Reads a page of what has come, and returns the number of bytes."""
        try:
            chunk = os.read(self._read, PAGE)
        except BlockingIOError:
            return 0
        self._rest += chunk
        return len(chunk)

    @property
    def address(self) -> list[int]:
        """Returns how another process finds it: pid, file descriptor, inode (the pid may mean another process
        there)."""
        return [os.getpid(), self._write, os.fstat(self._write).st_ino]

    def close(self) -> None:
        """Closes the pipe; who still writes gets an error."""
        os.close(self._read)
        os.close(self._write)


class MessageInbox(Inbox):
    """Receives a consumer's messages, in the order of sending."""

    def __init__(self, window: int) -> None:
        super().__init__()
        with contextlib.suppress(OSError):  # a user has so many pages in pipes; with fewer, less fits a record
            fcntl.fcntl(self._write, fcntl.F_SETPIPE_SZ, min((PAGES_PER_MESSAGE * window + 1) * PAGE, LARGEST))

    def take(self) -> list[bytes] | None:
        """Returns the frames of the next message, [] for one that is ELSEWHERE; None when nothing has come.

        Raises Malformed: what came is no record, and where the next one begins is not known.
        """
        while not self._rest or (frames := self._next()) is None:
            if not self.fill():
                return None
        return frames

    def pending(self, timeout_ms: float = 0) -> bool:
        """Waits at most this long, and tells whether `take` has something to do.

        Half a record whose writer died does not count.
        """
        data = self._rest
        complete = len(data) >= _HEAD.size and len(data) >= _HEAD.unpack_from(data)[0]
        return complete or bool(self._poll.poll(timeout_ms))

    def _next(self) -> list[bytes] | None:
        data = self._rest
        if len(data) < _HEAD.size:
            return None
        total, count = _HEAD.unpack_from(data)
        if not (at := _HEAD.size + 4 * count) <= total <= LONGEST:
            raise Malformed(f"a record of {total} bytes and {count} frames")
        if len(data) < total:
            return None
        frames = []
        for size in struct.unpack_from(f"<{count}I", data, _HEAD.size):
            frames.append(data[at : at + size])
            at += size
        if at != total:
            raise Malformed(f"frames that end at {at} in a record of {total} bytes")
        self._rest = data[total:]
        return frames


class CreditInbox(Inbox):
    """Receives a publisher's credits. A link is the number of one connection of one consumer."""

    def __init__(self) -> None:
        super().__init__()
        self.garbage = 0
        """Bytes that belonged to no record."""

    def take(self, links: Container[int]) -> list[tuple[int, bytes, int]]:
        """Returns what has come for these links: (link, operation, sequence number).

        Somebody who writes half a record cannot displace those of others: what does not begin with a known link is
        stepped over byte by byte.
        """
        while self.fill() == PAGE and len(self._rest) < 16 * PAGE:
            pass  # more than a page is rare, and more than a pipe holds is a flood
        credits, at, end = [], 0, len(self._rest) - _CREDIT.size
        while at <= end:
            link, op, seq = _CREDIT.unpack_from(self._rest, at)
            if link in links and op[1:] == _ZEROS:
                credits.append((link, op[:1], seq))
                at += _CREDIT.size
            else:
                self.garbage += 1
                at += 1
        self._rest = self._rest[at:]
        return credits


class Outlet:
    """Writes into a pipe of another process. Raises OSError when it cannot be opened from here."""

    def __init__(self, address: Sequence[int]) -> None:
        if len(address) != 3 or any(type(n) is not int for n in address):
            raise OSError("no address")
        pid, fd, inode = address
        self._fd = os.open(f"/proc/{pid}/fd/{fd}", os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        status = os.fstat(self._fd)
        if not stat.S_ISFIFO(status.st_mode) or status.st_ino != inode:
            self.close()
            raise OSError("not that pipe")

    def room(self, window: int) -> int:
        """Returns the longest record [bytes] of which `window` and some small ones always fit."""
        pages = fcntl.fcntl(self._fd, fcntl.F_GETPIPE_SZ) // PAGE
        return (pages - 1) // window * PAGE

    def write(self, record: bytes) -> bool:
        """Writes a record; False when the pipe is full. Where nobody reads any more, it counts as written."""
        try:
            return os.write(self._fd, record) == len(record)
        except BlockingIOError:
            return False
        except BrokenPipeError:
            return True  # the other side is gone, which shows elsewhere

    def write_credit(self, link: int, op: bytes, seq: int) -> bool:
        """Writes one credit; False when the pipe is full."""
        return self.write(_CREDIT.pack(link, op, seq))

    def close(self) -> None:
        """Closes the pipe."""
        os.close(self._fd)
