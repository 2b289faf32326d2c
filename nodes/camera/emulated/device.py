"""Implements what all emulated cameras share: descriptors, the data endpoint with its faults, unplugging."""

from __future__ import annotations

import abc
import errno
from collections import Counter
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NoReturn

import numpy as np
import usb.core

from nodes.camera.emulated.faults import Faults
from nodes.camera.emulated.feed import Feed
from nodes.camera.emulated.readout import Readout
from nodes.camera.usb.settings import UsbSettings

PACKET = 512
GARBAGE = bytes((37 * i + 11) & 0xFF for i in range(64))
LANGUAGE = 0x0409


@dataclass
class Identity:
    """Holds the contents of an emulated device's USB descriptors.

    endpoints in the order of the interface; those of `interrupt` are no bulk endpoints.
    """

    vendor: int
    product: int
    bcd_device: int
    name: str
    serial: str
    endpoints: tuple[int, ...]
    subclass: int = 0
    maker: str = "emulated"
    interrupt: tuple[int, ...] = ()


def stall() -> NoReturn:
    """Raises libusb's error for a request that the device does not know."""
    raise usb.core.USBError("Pipe error", -9, errno.EPIPE)


def timeout() -> NoReturn:
    """Raises libusb's error for data that did not come in time."""
    raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)


class EmulatedDevice(abc.ABC):
    """Emulates a device on the emulated bus.

    Subclasses answer requests and say whether their registers let the sensor send, and what of the events of a
    recording. HONOURED: settings of the driver that show in what it sends.
    """

    DATA: int
    HONOURED: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, identity: Identity, feed: Feed, faults: Faults, address: int = 1) -> None:
        self.identity, self.feed, self.faults, self.address = identity, feed, faults, address
        self.counts: Counter[str] = Counter()
        """Events that its registers kept back, by reason."""
        self.registers_changed = True
        """Set behind each write to a register: what reads the data looks at the registers then."""
        self.claimed = False
        self.halted: set[int] = set()
        self.sent = 0
        self._reads = 0
        self._unplugged = False

    # -- the maker's protocol ------------------------------------------------------------------------------------------

    @abc.abstractmethod
    def streaming(self) -> bool:
        """Tells whether the registers are set as they must be for the sensor to send."""

    @abc.abstractmethod
    def vendor_in(self, request: int, value: int, index: int) -> bytes:
        """Answers a vendor request."""

    @abc.abstractmethod
    def vendor_out(self, request: int, value: int, index: int, data: bytes) -> None:
        """Takes a vendor request with data."""

    def command(self, data: bytes) -> None:
        """Takes bytes on the command endpoint, where the device has one."""
        stall()

    def answer(self, timeout_s: float) -> bytes:
        """Returns the bytes that wait on the answer endpoint, or come in time; empty for nothing."""
        return b""

    def readout(self) -> Readout:
        """Returns the filter that the registers set on events now."""
        return Readout(self.counts)

    def ignored(self, settings: UsbSettings) -> list[str]:
        """Names the settings that differ from their defaults and have no effect on this device."""
        standard, host = type(settings)(), {f.name for f in fields(UsbSettings)}
        names = [f.name for f in fields(settings) if f.name not in host and f.name not in self.HONOURED]
        return [name for name in names if getattr(settings, name) != getattr(standard, name)]

    @abc.abstractmethod
    def power_up(self) -> None:
        """Sets the registers to their state after the device was plugged in."""

    # -- presence ------------------------------------------------------------------------------------------------------

    def present(self) -> bool:
        """Tells whether the device is on the bus.

        An unplugged device that is to be plugged in again comes back with this call.
        """
        if self._unplugged and self.faults.replug:
            self._unplugged = False
            self.faults.unplug_after = 0
            self.address += 1
            self.halted.clear()
            self.power_up()
        return not (self.faults.absent or self._unplugged)

    def check_present(self) -> None:
        """Raises libusb's error where the device is gone."""
        if self.faults.absent or self._unplugged:
            raise usb.core.USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)

    def check_claimed(self) -> None:
        """Raises libusb's error unless the interface was claimed: endpoints belong to the program that claimed it."""
        self.check_present()
        if not self.claimed:
            raise usb.core.USBError("Input/Output Error", -1, errno.EIO)

    # -- requests ------------------------------------------------------------------------------------------------------

    def request_in(self, kind: int, request: int, value: int, index: int) -> bytes:
        """Answers a control request for data from the device."""
        if kind == 0x80 and request == 6 and value >> 8 == 3:
            return self._string(value & 0xFF)
        if kind & 0x60 != 0x40:
            stall()
        if self.faults.control_timeout:
            timeout()
        return self.vendor_in(request, value, index)

    def request_out(self, kind: int, request: int, value: int, index: int, data: bytes) -> int:
        """Takes a control request with data for the device; returns how many bytes it took."""
        if kind & 0x60 != 0x40:
            stall()
        if self.faults.control_timeout:
            timeout()
        self.vendor_out(request, value, index, data)
        return len(data)

    def _string(self, index: int) -> bytes:
        if index == 0:
            return bytes([4, 3]) + LANGUAGE.to_bytes(2, "little")
        texts = {1: self.identity.maker, 2: self.identity.name, 3: self.identity.serial}
        if not texts.get(index):
            stall()
        body = texts[index].encode("utf-16-le")
        return bytes([len(body) + 2, 3]) + body

    # -- endpoints -----------------------------------------------------------------------------------------------------

    def bulk_out(self, endpoint: int, data: bytes) -> int:
        """Takes bytes on the command endpoint; returns how many."""
        if self.faults.control_timeout:
            timeout()
        self.command(data)
        return len(data)

    def bulk_in(self, endpoint: int, buffer: Any, timeout_s: float) -> int:
        """Reads bytes of an endpoint into `buffer`; returns how many."""
        if endpoint != self.DATA:
            data: bytes | memoryview = self.answer(timeout_s)
            if not data:
                timeout()
        else:
            data = self._stream(len(buffer), timeout_s)
        np.frombuffer(buffer, np.uint8)[: len(data)] = np.frombuffer(data, np.uint8)
        return len(data)

    def _stream(self, size: int, timeout_s: float) -> bytes | memoryview:
        """Reads the data endpoint, with the faults that are due."""
        f = self.faults
        if self.DATA in self.halted:
            stall()
        if not self.streaming():
            timeout()
        if self.registers_changed:
            self.registers_changed = False
            readout = self.readout()
            self.feed.register_filter = None if readout.passes_all else readout
        if f.unplug_after and self.sent >= f.unplug_after:
            self._unplugged = True
            self.check_present()
        self._reads += 1
        if f.stall_every and self._reads % f.stall_every == 0:
            self.halted.add(self.DATA)
            stall()
        if f.timeout_every and self._reads % f.timeout_every == 0:
            timeout()
        if f.garbage_every and self._reads % f.garbage_every == 0:
            return GARBAGE
        try:
            if f.lose_every and self._reads % f.lose_every == 0:
                self.feed.read(PACKET, 0)
            data = self.feed.read(min(size, f.short) if f.short else size, timeout_s)
        except EOFError:
            raise usb.core.USBError("End of the recording", None, errno.ENODATA) from None
        if not len(data):
            timeout()
        self.sent += len(data)
        return data
