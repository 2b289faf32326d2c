"""Keeps several reads waiting at a bulk endpoint at once, through libusb's asynchronous interface.

Between two synchronous reads nothing waits at the endpoint, for as long as Python takes to come back (milliseconds when
it is busy): at 200 MB/s that can be more than a camera holds. Here the next reads are already with the kernel. This
uses, by ctypes, the library and the handle that pyusb has opened; no further package is needed.
"""

from __future__ import annotations

import ctypes
import errno
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import usb.core

from nodes.camera.usb.reader import FAULTS, MAX_FAULTS, TIMEOUT_MS, Chunk, Reader

IN_FLIGHT = 16
"""Reads that wait at the endpoint."""
CANCEL_S = 5.0
BULK = 2
COMPLETED, FAILED, TIMED_OUT, CANCELLED, STALLED, GONE, OVERFLOWED = range(7)
"""libusb_transfer_status."""
ERRNO = {FAILED: errno.EIO, STALLED: errno.EPIPE, GONE: errno.ENODEV, OVERFLOWED: errno.EOVERFLOW}
INTERRUPTED = -10
SUBMIT_ERRNO = {-4: errno.ENODEV, -6: errno.EBUSY, -11: errno.ENOMEM}


_HELD: list[object] = []
"""Readers whose buffers libusb has not given back: they must not be freed."""


class _Transfer(ctypes.Structure):
    """Mirrors libusb_transfer without its isochronous part."""


_Callback = ctypes.CFUNCTYPE(None, ctypes.POINTER(_Transfer))
_Transfer._fields_ = [
    ("dev_handle", ctypes.c_void_p),
    ("flags", ctypes.c_uint8),
    ("endpoint", ctypes.c_ubyte),
    ("type", ctypes.c_ubyte),
    ("timeout", ctypes.c_uint),
    ("status", ctypes.c_int),
    ("length", ctypes.c_int),
    ("actual_length", ctypes.c_int),
    ("callback", _Callback),
    ("user_data", ctypes.c_void_p),
    ("buffer", ctypes.c_void_p),
    ("num_iso_packets", ctypes.c_int),
]


class _Interval(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("microseconds", ctypes.c_long)]


def available(device: Any) -> bool:
    """Tells whether the device was opened through libusb 1.0, which an emulated one was not."""
    return hasattr(device._ctx.backend, "lib") and hasattr(device._ctx.backend, "ctx")


def _library(device: Any) -> Any:
    """Returns the libusb that pyusb has loaded, with prototypes for the asynchronous interface."""
    lib = ctypes.CDLL(device._ctx.backend.lib._name)
    pointer = ctypes.POINTER(_Transfer)
    lib.libusb_alloc_transfer.argtypes, lib.libusb_alloc_transfer.restype = [ctypes.c_int], pointer
    for name in ("submit", "cancel"):
        function = getattr(lib, f"libusb_{name}_transfer")
        function.argtypes, function.restype = [pointer], ctypes.c_int
    lib.libusb_free_transfer.argtypes, lib.libusb_free_transfer.restype = [pointer], None
    events = lib.libusb_handle_events_timeout_completed
    events.argtypes = [ctypes.c_void_p, ctypes.POINTER(_Interval), ctypes.POINTER(ctypes.c_int)]
    events.restype = ctypes.c_int
    return lib


class QueuedReader(Reader):
    """Reads with a thread that keeps IN_FLIGHT reads at the endpoint, in order."""

    def __init__(self, device: Any, endpoint: int, recover: Callable[[], None], buffers: int, size: int) -> None:
        super().__init__(lambda buffer, timeout_ms: 0, recover, buffers + IN_FLIGHT, size)
        self._device, self._endpoint = device, endpoint
        self._lib = _library(device)
        self._context = device._ctx.backend.ctx
        self._callback = _Callback(self._on_end)
        self._returned: deque[int] = deque()
        self._in_flight: set[int] = set()
        self._chunks: dict[int, Chunk] = {}
        self._transfers = [self._lib.libusb_alloc_transfer(0) for _ in range(IN_FLIGHT)]
        if not all(self._transfers):
            raise OSError("libusb has no memory for transfers")
        self._number = {ctypes.addressof(t.contents): i for i, t in enumerate(self._transfers)}

    def _on_end(self, transfer: Any) -> None:
        """Notes a transfer that has ended; libusb calls it within `_wait_events`."""
        number = self._number[ctypes.addressof(transfer.contents)]
        self._in_flight.discard(number)
        self._returned.append(number)

    def _run(self) -> None:
        try:
            for number in range(IN_FLIGHT):
                self._submit(number, self._free.pop())
            while not self._stop:
                self._wait_events()
                while self._returned:
                    self._handle_returned(self._returned.popleft())
        except Exception as error:
            with self._changed:
                self._failure = error
                self._changed.notify_all()
        finally:
            self._free_transfers()

    def _free_transfers(self) -> None:
        """Frees the transfers; where libusb still holds some, all stay, with their buffers."""
        try:
            self._cancel_all()
        except OSError as error:
            _HELD.append(self)
            self._failure = self._failure or error
            return
        for transfer in self._transfers:
            self._lib.libusb_free_transfer(transfer)

    def _submit(self, number: int, chunk: Chunk) -> None:
        """Submits a read into a buffer. Raises usb.core.USBError."""
        t = self._transfers[number].contents
        t.dev_handle, t.flags, t.endpoint, t.type = self._device._ctx.handle.handle, 0, self._endpoint, BULK
        t.timeout, t.callback, t.user_data, t.num_iso_packets = TIMEOUT_MS, self._callback, None, 0
        t.buffer, t.length = chunk.buffer.buffer_info()[0], len(chunk.buffer)
        self._chunks[number] = chunk
        code = self._lib.libusb_submit_transfer(self._transfers[number])
        if code:
            raise usb.core.USBError("a read could not be submitted", code, SUBMIT_ERRNO.get(code, errno.EIO))
        self._in_flight.add(number)

    def _wait_events(self) -> None:
        """Waits until transfers end, 50 ms at the longest. Raises OSError."""
        code = self._lib.libusb_handle_events_timeout_completed(self._context, _Interval(0, 50_000), None)
        if code and code != INTERRUPTED:
            raise OSError(f"libusb failed while waiting for data (code {code})")

    def _handle_returned(self, number: int) -> None:
        """Takes what a read brought, and submits the next one in its place."""
        self._take(number)
        status = self._transfers[number].contents.status
        if status not in (COMPLETED, TIMED_OUT):
            self._restart(status)
            return
        self._faults = 0
        self._submit(number, self._chunks[number])

    def _take(self, number: int) -> None:
        """Stores what a read brought, also before it failed or was cancelled; its next buffer is then another one."""
        size = self._transfers[number].contents.actual_length
        with self._changed:
            if size and self._has_room():
                self._store(self._chunks[number], size)
                self._chunks[number] = self._free.pop()
            else:
                self._count_lost(size)

    def _restart(self, status: int) -> None:
        """Starts reading again after a read that failed: cancels all others, clears the endpoint, submits them anew."""
        error = ERRNO.get(status, errno.EIO)
        self._faults += 1
        if error not in FAULTS or self._faults > MAX_FAULTS:
            raise usb.core.USBError("the stream broke", None, error)
        self.counts[FAULTS[error]] += 1
        self._gap = True
        self._cancel_all()
        while self._returned:
            self._take(self._returned.popleft())
        if error == errno.EPIPE:
            self._recover()
        for number, chunk in list(self._chunks.items()):
            self._submit(number, chunk)

    def _cancel_all(self) -> None:
        """Cancels all reads in flight, and waits until libusb has let go of every buffer. Raises OSError."""
        for number in list(self._in_flight):
            self._lib.libusb_cancel_transfer(self._transfers[number])
        deadline = time.monotonic() + CANCEL_S
        while self._in_flight:
            self._wait_events()
            if time.monotonic() > deadline:
                raise OSError(f"USB does not give back {len(self._in_flight)} reads that were cancelled")
