"""The queue of reads on a libusb of this test: reads end in order, with the bytes and the status that it says."""

from __future__ import annotations

import ctypes
import time
from collections import deque
from types import SimpleNamespace
from typing import Any

import pytest
import usb.core

from nodes.camera.usb import queue
from nodes.camera.usb.queue import CANCELLED, COMPLETED, FAILED, GONE, STALLED, TIMED_OUT, QueuedReader

SIZE = 64
NOT_FOUND = -5
"""libusb's answer for a transfer that has ended."""


class Library:
    """Ends one read per call with the next of `script`, (status, bytes); after a stall none until it is cleared."""

    def __init__(self, *script: tuple[int, bytes]) -> None:
        self.script = deque(script)
        self.waiting: deque[Any] = deque()
        self.cancelled: deque[Any] = deque()
        self.halted = False
        self.freed = 0

    def libusb_alloc_transfer(self, packets: int) -> Any:
        return ctypes.pointer(queue._Transfer())

    def libusb_free_transfer(self, transfer: Any) -> None:
        self.freed += 1

    def libusb_submit_transfer(self, transfer: Any) -> int:
        self.waiting.append(transfer)
        return 0

    def libusb_cancel_transfer(self, transfer: Any) -> int:
        for waiting in self.waiting:
            if ctypes.addressof(waiting.contents) == ctypes.addressof(transfer.contents):
                self.waiting.remove(waiting)
                self.cancelled.append(waiting)
                return 0
        return NOT_FOUND

    def libusb_handle_events_timeout_completed(self, context: Any, timeout: Any, done: Any) -> int:
        if self.cancelled:
            self.end(self.cancelled.popleft(), CANCELLED, b"")
        elif self.script and self.waiting and not self.halted:
            self.end(self.waiting.popleft(), *self.script.popleft())
        else:
            time.sleep(0.001)
        return 0

    def end(self, transfer: Any, status: int, data: bytes) -> None:
        t = transfer.contents
        assert len(data) <= t.length
        ctypes.memmove(t.buffer, data, len(data))
        t.status, t.actual_length = status, len(data)
        self.halted |= status == STALLED
        t.callback(transfer)


def read_all(monkeypatch: pytest.MonkeyPatch, library: Library, buffers: int = 64) -> tuple[list[Any], QueuedReader]:
    """What a reader gives until the device is gone: (bytes, whether something is missing before them, lost)."""
    monkeypatch.setattr(queue, "_library", lambda device: library)
    device: Any = SimpleNamespace(
        _ctx=SimpleNamespace(backend=SimpleNamespace(ctx=None), handle=SimpleNamespace(handle=None))
    )

    def recover() -> None:
        library.halted = False

    reader = QueuedReader(device, 0x82, recover, buffers, SIZE)
    reader.start()
    reader._thread.join(20)  # nothing is given back before the end
    found = []
    with pytest.raises(usb.core.USBError, match="the stream broke"):
        while True:
            chunk = reader.get(1.0)
            assert chunk is not None
            found.append((chunk.data.tobytes(), chunk.gap, chunk.lost))
    reader.close()
    assert library.freed == queue.IN_FLIGHT
    return found, reader


def pieces(count: int) -> list[bytes]:
    return [bytes([k]) * (k % 7 + 1) for k in range(1, count + 1)]


def test_reads_come_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    sent = pieces(100)
    found, reader = read_all(
        monkeypatch, Library(*((COMPLETED, piece) for piece in sent), (TIMED_OUT, b"x"), (GONE, b""))
    )
    assert found == [(piece, False, 0) for piece in [*sent, b"x"]]
    assert not reader.counts and reader.bytes == sum(map(len, sent)) + 1


@pytest.mark.parametrize(("status", "counter"), [(STALLED, "stalls"), (FAILED, "transfer_errors")])
def test_what_came_before_a_read_failed_is_kept(status: int, counter: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was thrown away with the read, and counted nowhere."""
    library = Library((COMPLETED, b"one"), (status, b"two"), (COMPLETED, b"three"), (GONE, b"four"))
    found, reader = read_all(monkeypatch, library)
    assert found == [(b"one", False, 0), (b"two", False, 0), (b"three", True, 0), (b"four", False, 0)]
    assert reader.counts == {counter: 1}


def test_what_came_while_the_others_were_cancelled_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reads that ended after the one that failed, and before they could be cancelled."""

    class Late(Library):
        def libusb_cancel_transfer(self, transfer: Any) -> int:
            if self.script and self.script[0][0] == COMPLETED:
                self.end(self.waiting.popleft(), *self.script.popleft())
            return super().libusb_cancel_transfer(transfer)

    library = Late((COMPLETED, b"one"), (FAILED, b""), (COMPLETED, b"two"), (COMPLETED, b"three"), (GONE, b""))
    found, _ = read_all(monkeypatch, library)
    assert found == [(b"one", False, 0), (b"two", True, 0), (b"three", False, 0)]


def test_bytes_without_room_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Full buffers that nobody gives back: all else is lost, to the byte."""
    sent = [bytes([k]) * SIZE for k in range(40)]
    found, reader = read_all(monkeypatch, Library(*((COMPLETED, piece) for piece in sent), (GONE, b"")), buffers=4)
    assert [data for data, _, _ in found] == sent[: len(found)] and 4 <= len(found) < 40
    assert reader.counts["bytes_lost"] == SIZE * (40 - len(found))
