"""Writes and reads the messages of a bag in CDR, the wire encoding of ROS 2. `evis.files.cdr` says what that is."""

from __future__ import annotations

import struct

import numpy as np

from evis.bag import BagError
from evis.files.cdr import ENCAPSULATION, MessageReader

RANGE = (
    "a bag's times go from 0 to 2^31 s; of a recording `evis events convert IN OUT --rebase` makes one "
    "whose times count from its first"
)
"""End of an error: which times a bag holds, and what to do about a recording with others."""

_NUMBERS = {code: struct.Struct("<" + code) for code in "bBhHiIqQfd"}
_PADDING = tuple(bytes(count) for count in range(8))


class CdrWriter:
    """Writes one message in CDR; `bytes()` returns all that was written so far."""

    def __init__(self) -> None:
        self.buffer = bytearray(ENCAPSULATION)

    def align(self, size: int) -> None:
        """Pads to a multiple of `size` bytes."""
        self.buffer += bytes(-(len(self.buffer) - 4) % size)

    def number(self, code: str, value: float) -> None:
        """Writes one number; `code` as in `struct` (b B h H i I q Q f d)."""
        kind = _NUMBERS[code]
        self.buffer += _PADDING[(4 - len(self.buffer)) % kind.size]
        self.buffer += kind.pack(value)

    def string(self, text: str) -> None:
        """Writes the length with the closing NUL, the UTF-8 bytes, NUL."""
        raw = text.encode()
        self.number("I", len(raw) + 1)
        self.buffer += raw + b"\x00"

    def doubles(self, values: np.ndarray) -> None:
        """Writes a fixed-size array of float64; nothing at all where it is empty."""
        if np.size(values):
            self.align(8)
            self.buffer += np.ascontiguousarray(values, "<f8").tobytes()

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """Writes a std_msgs/Header: seconds (int32), nanoseconds (uint32), frame. Raises BagError outside of 0 .. 68
        years.
        """
        seconds, nanoseconds = ros_time(stamp_ns)
        self.number("i", seconds)
        self.number("I", nanoseconds)
        self.string(frame_id)


def ros_time(stamp_ns: int) -> tuple[int, int]:
    """Converts a stamp [ns] to ROS's (seconds, nanoseconds)."""
    seconds, nanoseconds = divmod(int(stamp_ns), 1_000_000_000)
    if not 0 <= seconds < 1 << 31:
        raise BagError(f"stamp {stamp_ns} ns cannot be recorded: {RANGE}")
    return seconds, nanoseconds


class CdrReader(MessageReader):
    """Reads one message of a bag, and checks every length against the bytes that are there. Raises BagError."""

    def __init__(self, data: bytes | memoryview, what: str) -> None:
        super().__init__(data, what, BagError)
