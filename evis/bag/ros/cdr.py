"""CDR, the wire encoding of ROS 2 messages: little endian, every number aligned to its own size.

Alignment counts from the byte after the 4-byte encapsulation header, which says 00 01 = plain CDR, little endian
(OMG DDSI-RTPS 2.3, section 10).
"""

from __future__ import annotations

import struct

import numpy as np

from evis.bag import BagError

ENCAPSULATION = b"\x00\x01\x00\x00"
"""Plain CDR, little endian."""


class CdrWriter:
    """Builds one message; `bytes()` of everything written so far."""

    def __init__(self) -> None:
        self.buffer = bytearray(ENCAPSULATION)

    def align(self, size: int) -> None:
        """Pad to a multiple of `size` bytes."""
        self.buffer += bytes(-(len(self.buffer) - 4) % size)

    def number(self, code: str, value: float) -> None:
        """One number; `code` as in `struct` (b B h H i I q Q f d)."""
        self.align(struct.calcsize("<" + code))
        self.buffer += struct.pack("<" + code, value)

    def string(self, text: str) -> None:
        """Length with the closing NUL, the UTF-8 bytes, NUL."""
        raw = text.encode()
        self.number("I", len(raw) + 1)
        self.buffer += raw + b"\x00"

    def doubles(self, values: np.ndarray) -> None:
        """A fixed-size array of float64; nothing at all where it is empty."""
        if np.size(values):
            self.align(8)
            self.buffer += np.ascontiguousarray(values, "<f8").tobytes()

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """std_msgs/Header: seconds (int32), nanoseconds (uint32), frame. Raises BagError outside of 0 .. 68 years."""
        seconds, nanoseconds = ros_time(stamp_ns)
        self.number("i", seconds)
        self.number("I", nanoseconds)
        self.string(frame_id)


def ros_time(stamp_ns: int) -> tuple[int, int]:
    """Stamp [ns] as ROS's (seconds, nanoseconds)."""
    seconds, nanoseconds = divmod(int(stamp_ns), 1_000_000_000)
    if not 0 <= seconds < 1 << 31:
        raise BagError(f"stamp {stamp_ns} ns cannot be recorded: a bag's times go from 0 to 2^31 s")
    return seconds, nanoseconds


class CdrReader:
    """Takes one message apart, checking every length against the bytes that are there. Raises BagError."""

    def __init__(self, data: bytes | memoryview, what: str) -> None:
        self.data = memoryview(data)
        self.what = what
        if len(self.data) < 4 or bytes(self.data[:2]) != ENCAPSULATION[:2]:
            raise BagError(f"{what} is not little-endian CDR")
        self.at = 4

    def take(self, size: int) -> memoryview:
        """The next `size` bytes, not copied."""
        end = self.at + size
        if end > len(self.data):
            raise BagError(f"{self.what} ends after {len(self.data)} bytes, {end} are needed")
        part, self.at = self.data[self.at : end], end
        return part

    def number(self, code: str) -> int | float:
        """One number; `code` as in `struct`."""
        size = struct.calcsize("<" + code)
        self.at += -(self.at - 4) % size
        return struct.unpack("<" + code, self.take(size))[0]

    def integer(self, code: str) -> int:
        """One whole number."""
        return int(self.number(code))

    def string(self) -> str:
        """Text; bytes that are not UTF-8 are replaced."""
        return bytes(self.take(self.integer("I"))).rstrip(b"\x00").decode(errors="replace")

    def doubles(self, count: int) -> np.ndarray:
        """A fixed-size array of float64."""
        if count:
            self.at += -(self.at - 4) % 8
        return np.frombuffer(self.take(8 * count), "<f8")

    def blob(self) -> memoryview:
        """A sequence of bytes, not copied."""
        return self.take(self.integer("I"))

    def header(self) -> tuple[int, str]:
        """std_msgs/Header as (stamp [ns], frame)."""
        seconds = self.integer("i")
        return seconds * 1_000_000_000 + self.integer("I"), self.string()
