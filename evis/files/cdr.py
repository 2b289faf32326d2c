"""Takes serialised ROS messages apart: CDR as ROS 2 sends it, and the packed layout of ROS 1.

In CDR every number is aligned to its own size, counted from the byte after the 4-byte encapsulation header, which says
00 01 = plain CDR, little endian (OMG DDSI-RTPS 2.3, section 10). ROS 1 has no header and no alignment.
"""

from __future__ import annotations

import struct

import numpy as np

ENCAPSULATION = b"\x00\x01\x00\x00"
"""Plain CDR, little endian."""


class MessageReader:
    """Reads one message from its start, checking every length against the bytes that are there.

    what: the message's name in errors. error: the exception that is raised for a damaged message. cdr: False for the
    layout of ROS 1. cut: the message may end early.
    """

    def __init__(
        self, data: bytes | memoryview, what: str, error: type[Exception], cdr: bool = True, cut: bool = False
    ) -> None:
        self.data, self.what, self.cdr, self.cut = memoryview(data), what, cdr, cut
        self._error = error
        self.at = len(ENCAPSULATION) if cdr else 0
        if cdr and (len(self.data) < self.at or bytes(self.data[:2]) != ENCAPSULATION[:2]):
            raise error(f"{what} is not little-endian CDR")

    def take(self, size: int) -> memoryview:
        """Takes the next `size` bytes, not copied."""
        end = self.at + size
        if end > len(self.data):
            raise self._error(f"{self.what} ends after {len(self.data)} bytes, {end} are needed")
        part, self.at = self.data[self.at : end], end
        return part

    def number(self, code: str) -> int | float:
        """Reads one number; `code` as in `struct` (b B h H i I q Q f d)."""
        size = struct.calcsize("<" + code)
        self._align(size)
        return struct.unpack("<" + code, self.take(size))[0]

    def integer(self, code: str) -> int:
        """Reads one whole number."""
        return int(self.number(code))

    def string(self) -> str:
        """Reads text; bytes that are not UTF-8 are replaced."""
        return bytes(self.take(self.integer("I"))).rstrip(b"\x00").decode(errors="replace")

    def doubles(self, count: int) -> np.ndarray:
        """Reads a fixed-size array of float64."""
        if count:
            self._align(8)
        return np.frombuffer(self.take(8 * count), "<f8")

    def blob(self) -> memoryview:
        """Reads a sequence of bytes, not copied; of a cut message, what is there."""
        size = self.integer("I")
        return self.take(min(size, len(self.data) - self.at) if self.cut else size)

    def header(self) -> tuple[int, str]:
        """Reads a std_msgs/Header as (stamp [ns], frame); ROS 1 has a sequence number in front of them."""
        if not self.cdr:
            self.integer("I")
        seconds = self.integer("i")
        return seconds * 1_000_000_000 + self.integer("I"), self.string()

    def _align(self, size: int) -> None:
        if self.cdr:
            self.at += -(self.at - len(ENCAPSULATION)) % size
