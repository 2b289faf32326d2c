"""Empties a camera's bulk endpoint into preallocated buffers, in a thread.

A camera cannot be told to wait. When all buffers are full the thread goes on reading into a spare one, counts what it
throws away, and marks the next good buffer, so that the decoder knows that bytes are missing before it. A read that
brought little is copied out, so that a quiet camera's many short transfers do not use up the buffers: the bound is on
bytes.
"""

from __future__ import annotations

import array
import errno
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import numpy as np
import usb.core

TIMEOUT_MS = 100
"""Longest single read [ms]; what has arrived by then is handed over."""
RESUME_SHARE = 16
"""Reading resumes after an overflow when one in so many buffers is free."""
MAX_FAULTS = 20
"""Reads that fail one after the other (stalls, transfer errors) before the stream is given up."""

FAULTS = {errno.EPIPE: "stalls", errno.EOVERFLOW: "usb_overflows", errno.EIO: "transfer_errors"}
"""Failures after which the stream goes on, with the names of their counters."""


class Chunk:
    """Holds one buffer: `data` (uint8 view of what was read), host time of its arrival [ns], bytes lost before it.

    gap: something is missing before it even where `lost` cannot say how much (a stall in the middle of the stream).
    reads: how many reads it holds.
    """

    __slots__ = ("buffer", "data", "gap", "lost", "reads", "t_host_ns", "whole")

    def __init__(self, size: int) -> None:
        self.buffer = array.array("B", bytes(size))
        self.whole = np.frombuffer(self.buffer, np.uint8) if size else np.empty(0, np.uint8)
        self.data = self.whole[:0]
        self.lost, self.gap, self.t_host_ns, self.reads = 0, False, 0, 1


class Reader:
    """Reads an endpoint in a thread until `close`.

    read(buffer, timeout_ms) -> bytes; recover() clears a stalled endpoint.

    wait_when_full: do not read while all buffers are full. For sources that can wait (an emulated device playing a
    file as fast as it is read); a real one would overflow inside instead, uncounted.
    """

    def __init__(
        self,
        read: Callable[[Any, int], int],
        recover: Callable[[], None],
        buffers: int,
        size: int,
        wait_when_full: bool = False,
    ) -> None:
        self._read, self._recover, self._wait_when_full = read, recover, wait_when_full
        self._free = deque(Chunk(size) for _ in range(buffers))
        self._spare = Chunk(size)
        self._full: deque[Chunk] = deque()
        self._small_bytes, self._small_limit, self._small_read = 0, buffers * size, size // 8
        self._changed = threading.Condition()
        self._resume, self._dropping = max(1, buffers // RESUME_SHARE), False
        self._stop = False
        self._failure: Exception | None = None
        self._lost, self._gap, self._faults = 0, False, 0
        self.counts: Counter[str] = Counter()
        self.bytes = 0
        self.longest_pause_ns = 0
        """Longest time between the end of one read and the start of the next: nothing waited at the endpoint."""
        self._read_end_ns = 0
        self._thread = threading.Thread(target=self._run, name="usb-reader", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def get(self, timeout_s: float, joined: bool = False) -> Chunk | None:
        """Returns the next filled buffer, None after timeout_s. Raises what ended the stream, after its last buffer.

        joined: small reads that wait in a row come as one, for each costs the decoder about the same.
        """
        with self._changed:
            if not self._full and self._failure is None:
                self._changed.wait(timeout_s)
            if self._full:
                return self._join_small(self._full.popleft()) if joined else self._full.popleft()
            if self._failure is not None:
                raise self._failure
            return None

    def _join_small(self, chunk: Chunk) -> Chunk:
        """Returns a small read together with those behind it, as far as nothing is missing between them."""
        parts, size = [chunk.data], len(chunk.data)
        while self._full and not len(chunk.whole):
            following = self._full[0]
            size += len(following.data)
            if len(following.whole) or following.gap or size > self._small_read:
                break
            chunk.t_host_ns = self._full.popleft().t_host_ns
            parts.append(following.data)
        if len(parts) > 1:
            chunk.data, chunk.reads = np.concatenate(parts), len(parts)
        return chunk

    @property
    def empty(self) -> bool:
        """Tells whether no filled buffer is waiting."""
        return not self._full

    def give_back(self, chunk: Chunk) -> None:
        """Returns the chunk's memory to the reader, to be written again."""
        with self._changed:
            if len(chunk.whole):
                self._free.append(chunk)
            else:
                self._small_bytes -= len(chunk.data)
            self._changed.notify_all()

    def close(self) -> None:
        """Ends the thread."""
        with self._changed:
            self._stop = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(5.0)

    # -- the thread ---------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._stop:
                with self._changed:
                    # the one used last is still in the cache
                    chunk = self._free.pop() if self._has_room() else None
                    if chunk is None and self._wait_when_full:
                        self._changed.wait(0.05)
                        continue
                self._fill(chunk or self._spare, chunk is None)
        except Exception as error:
            with self._changed:
                self._failure = error
                self._changed.notify_all()

    def _fill(self, chunk: Chunk, overflow: bool) -> None:
        """Reads into a chunk and queues it; on overflow, into the spare one, whose bytes are counted as lost."""
        size = self._read_once(chunk)
        self._read_end_ns = time.monotonic_ns()
        with self._changed:
            if overflow:
                self._count_lost(size)
            elif size:
                self._store(chunk, size)
            else:
                self._free.append(chunk)

    def _has_room(self) -> bool:
        """Tells whether a buffer may be filled: one is free, or, after an overflow, a RESUME_SHARE of all.

        One long gap costs less than many short ones, each of which the decoder leaves only at the next time word.
        """
        self._dropping = len(self._free) < (self._resume if self._dropping else 1)
        return not self._dropping

    def _count_lost(self, size: int) -> None:
        """Counts what a read brought as lost, for want of a free buffer."""
        if size:
            self._lost += size
            self._gap = True
            self.counts["buffers_overflowed"] += 1
            self.counts["bytes_lost"] += size

    def _is_small(self, size: int) -> bool:
        """Tells whether a read brought so little that it is copied out of its buffer."""
        return size <= self._small_read and self._small_bytes + size <= self._small_limit

    def _store(self, chunk: Chunk, size: int) -> None:
        """Queues what a read brought; the buffer of a small read, which is copied out, is free again at once."""
        self.bytes += size
        data = chunk.whole[:size]
        if self._is_small(size):
            self._free.append(chunk)
            chunk, data = Chunk(0), data.copy()
            self._small_bytes += size
        chunk.data, chunk.t_host_ns = data, time.monotonic_ns()
        chunk.lost, chunk.gap = self._lost, self._gap
        self._lost, self._gap = 0, False
        self._full.append(chunk)
        self._changed.notify_all()

    def _read_once(self, chunk: Chunk) -> int:
        """Reads once and returns the number of bytes, 0 when none came. Counts stalls and clears them; raises other
        failures."""
        if self._read_end_ns:
            self.longest_pause_ns = max(self.longest_pause_ns, time.monotonic_ns() - self._read_end_ns)
        try:
            size = self._read(chunk.buffer, TIMEOUT_MS)
        except usb.core.USBTimeoutError:
            return 0
        except usb.core.USBError as error:
            name = FAULTS.get(error.errno or 0)
            self._faults += 1
            if name is None or self._faults > MAX_FAULTS:
                raise
            self.counts[name] += 1
            self._gap = True
            if error.errno == errno.EPIPE:
                self._recover()
            return 0
        self._faults = 0
        return size
