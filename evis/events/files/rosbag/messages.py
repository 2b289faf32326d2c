"""Reads event messages of ROS 1 and ROS 2: event_camera_msgs/EventPacket, dvs_msgs and prophesee_event_msgs
EventArray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.events.arrays import Events
from evis.events.files.reading.decompress import DamagedError
from evis.files.cdr import MessageReader

PACKETS = ("event_camera_msgs/EventPacket", "event_array_msgs/EventArray")
ARRAYS = ("dvs_msgs/EventArray", "prophesee_event_msgs/EventArray")
TYPES = PACKETS + ARRAYS

# an event of an EventArray: u16 x, u16 y, u32 seconds, u32 nanoseconds, u8 polarity; packed in ROS 1
_FIELDS = {"names": ["x", "y", "s", "ns", "p"], "formats": ["<u2", "<u2", "<u4", "<u4", "u1"]}
_ROS1 = np.dtype({**_FIELDS, "offsets": [0, 2, 4, 8, 12], "itemsize": 13})  # type: ignore[call-overload]
# in CDR numbers are aligned to their size: the first event begins at a multiple of 4, all others 2 bytes behind one
_CDR_FIRST = np.dtype({**_FIELDS, "offsets": [0, 2, 4, 8, 12], "itemsize": 14})  # type: ignore[call-overload]
_CDR = np.dtype({**_FIELDS, "offsets": [0, 2, 6, 10, 14], "itemsize": 16})  # type: ignore[call-overload]


def plain_type(name: str) -> str:
    """Removes `/msg/` from a type: `dvs_msgs/msg/EventArray` gives `dvs_msgs/EventArray`."""
    return name.replace("/msg/", "/")


@dataclass
class Packet:
    """Holds an EventPacket: `events` as its encoding has them; `time_base_ns` as the sender set it."""

    width: int
    height: int
    seq: int
    time_base_ns: int
    encoding: str
    big_endian: bool
    events: memoryview


def read_packet(data: bytes | memoryview, cdr: bool, cut: bool = False) -> Packet:
    """Reads an EventPacket. Raises DamagedError."""
    reader = MessageReader(data, "a message", DamagedError, cdr, cut)
    reader.header()
    height, width, seq, base = (reader.integer(c) for c in "IIQQ")
    encoding, big = reader.string(), reader.integer("B")
    return Packet(width, height, seq, base, encoding, bool(big), reader.blob())


def read_array(data: bytes | memoryview, cdr: bool, cut: bool = False) -> tuple[int, int, Events]:
    """Reads (width, height, events) of an EventArray. Raises DamagedError."""
    reader = MessageReader(data, "a message", DamagedError, cdr, cut)
    reader.header()
    height, width, n = (reader.integer("I") for _ in range(3))
    rest = reader.data[reader.at :]
    rows = _cdr_rows(rest, n) if cdr else np.frombuffer(rest, _ROS1, min(n, len(rest) // 13))
    if len(rows) < n and not cut:
        raise DamagedError(f"a message claims {n} events and holds {len(rows)}")
    t = rows["s"].astype(np.int64) * 1_000_000_000 + rows["ns"]
    return width, height, Events(t, rows["x"].copy(), rows["y"].copy(), (rows["p"] != 0).view(np.uint8))


def _cdr_rows(data: memoryview, n: int) -> np.ndarray:
    # the last event lacks the padding that the others have behind them
    padded = np.frombuffer(bytes(data) + b"\0", np.uint8)
    whole = min(n, 0 if len(data) < 13 else 1 + (len(padded) - 14) // 16)
    rows = np.empty(whole, _CDR)
    if whole:
        first = np.frombuffer(padded, _CDR_FIRST, 1)
        others = np.frombuffer(padded, _CDR, whole - 1, 14)
        for name in _FIELDS["names"]:
            rows[name][:1], rows[name][1:] = first[name], others[name]
    return rows
