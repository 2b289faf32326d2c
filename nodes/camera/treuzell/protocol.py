"""Implements the Treuzell command protocol: frames of property, length and payload over two bulk endpoints.

Little endian: `u32 property | u32 bytes of payload | payload`. A write adds 0x4000_0000 to the property, a
failure in the answer 0x8000_0000. Facts from the public sources of Prophesee's openeb (Apache-2.0).
"""

from __future__ import annotations

import errno
import os
import struct
import threading
from typing import Any

CONTROL_IN, CONTROL_OUT, DATA_IN = 0x82, 0x02, 0x81
WRITE, FAILURE = 0x4000_0000, 0x8000_0000
FPGA_READ, FPGA_WRITE = 0x55, 0x56
SERIAL, RELEASE, BUILD_DATE = 0x72, 0x79, 0x7A
DEVICE_COUNT, DEVICE_NAME, DEVICE_COMPATIBLE, DEVICE_ENABLE = 0x1_0000, 0x1_0001, 0x1_0003, 0x1_0010
REGISTERS = 0x1_0102
MAX_ANSWER = 1024
OUT_MS, IN_MS = 1000, 10_000


class TreuzellError(OSError):
    """Reports that the board refused a command, or is not the one it seemed to be."""


class Board:
    """Sends commands to one board, one at a time."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self._lock = threading.Lock()

    def command(self, code: int, payload: bytes = b"") -> bytes:
        """Sends a command and returns the payload of the answer. Raises TreuzellError, usb.core.USBError."""
        with self._lock:
            self._device.write(CONTROL_OUT, struct.pack("<II", code, len(payload)) + payload, OUT_MS)
            answer = bytes(self._device.read(CONTROL_IN, MAX_ANSWER, IN_MS))
        if len(answer) < 8:
            raise TreuzellError(f"command {code:#x}: the answer has {len(answer)} bytes, a frame has at least 8")
        got, size = struct.unpack_from("<II", answer)
        body = answer[8 : 8 + size]
        if got == FAILURE:
            raise TreuzellError(f"command {code:#x} is not known to the board's firmware")
        if got & FAILURE:
            code_of = struct.unpack_from("<I", body, 8)[0] if len(body) >= 12 else errno.EIO
            raise TreuzellError(f"command {code:#x} failed: {os.strerror(code_of & 0xFF)}")
        if got != code or len(body) != size:
            raise TreuzellError(f"command {code:#x}: answer {got:#x} with {len(body)} of {size} bytes")
        return body

    # -- identity ------------------------------------------------------------------------------------------------------

    def serial(self) -> str:
        """Reads the serial number as the maker's tools print it: eight hex digits, or more."""
        body = self.command(SERIAL)
        return f"{int.from_bytes(body[:8], 'little'):08x}"

    def release(self) -> tuple[int, int, int]:
        """Reads the firmware version."""
        (value,) = struct.unpack_from("<I", self.command(RELEASE).ljust(4, b"\0"))
        return value >> 16, value >> 8 & 0xFF, value & 0xFF

    def compatible(self) -> list[list[str]]:
        """Reads the compatible strings of each sub-device."""
        (count,) = struct.unpack_from("<I", self.command(DEVICE_COUNT).ljust(4, b"\0"))
        if count > 16:
            raise TreuzellError(f"the board states {count} sub-devices")
        result = []
        for index in range(count):
            body = self.command(DEVICE_COMPATIBLE, struct.pack("<I", index))[4:]
            result.append([s.decode("ascii", "replace") for s in body.split(b"\0") if s])
        return result

    # -- registers -----------------------------------------------------------------------------------------------------

    def read(self, sub_device: int, address: int) -> int:
        """Reads one 32-bit register."""
        body = self.command(REGISTERS, struct.pack("<III", sub_device, address, 1))
        if len(body) < 12:
            raise TreuzellError(f"register {address:#x}: the answer has no value")
        return int(struct.unpack_from("<I", body, 8)[0])

    def write(self, sub_device: int, address: int, *values: int) -> None:
        """Writes consecutive 32-bit registers from an address."""
        self.command(REGISTERS | WRITE, struct.pack(f"<{2 + len(values)}I", sub_device, address, *values))

    def write_legacy(self, address: int, value: int) -> None:
        """Writes one register by the older FPGA property (Gen3.1 boards take both)."""
        self.command(FPGA_WRITE | WRITE, struct.pack("<II", address, value))
