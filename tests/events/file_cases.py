"""Small files of formats that have no writer here, made by independent code, for the tests of the readers."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import numpy as np

from evis.events import Events


def nmnist(events: Events) -> bytes:
    """5 bytes an event."""
    rows = zip((events.t // 1000).tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist())
    return b"".join(bytes((x, y, p << 7 | t >> 16 & 127, t >> 8 & 255, t & 255)) for t, x, y, p in rows)


def aedat2_davis(events: Events) -> bytes:
    """Header and polarity events of a DAVIS346."""
    head = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346blue\r\n"
    rows = zip((events.t // 1000).tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist())
    return head + b"".join(struct.pack(">Ii", y << 22 | x << 12 | p << 11, t) for t, x, y, p in rows)


AEDAT3_HEAD = (
    b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS346\r\n"
    b"#Start-Time: 2020-01-01 00:00:00 (TZ+0000)\r\n#!END-HEADER\r\n"
)


def aedat3_packet(kind: int, size: int, rows: list[bytes], overflow: int = 0) -> bytes:
    """A packet of rows of `size` bytes."""
    head = struct.pack("<hhiiiiii", kind, 1, size, 4, overflow, len(rows), len(rows), len(rows))
    return head + b"".join(row.ljust(size, b"\0") for row in rows)


def aedat3(events: Events, per_packet: int = 50) -> bytes:
    """Polarity packets."""
    rows = zip((events.t // 1000).tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist())
    packed = [struct.pack("<Ii", x << 17 | y << 2 | p << 1 | 1, t) for t, x, y, p in rows]
    return AEDAT3_HEAD + b"".join(
        aedat3_packet(1, 8, packed[a : a + per_packet]) for a in range(0, len(packed), per_packet)
    )


def text_zip(events: Events) -> bytes:
    """E2VID: the size on the first line, then t x y p."""
    lines = ["640 480"] + [
        f"{t // 10**9}.{t % 10**9:09d} {x} {y} {p}"
        for t, x, y, p in zip(events.t.tolist(), events.x, events.y, events.p)
    ]
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("events.txt", "\n".join(lines) + "\n")
    return out.getvalue()


def dvs_array_ros1(events: Events, width: int, height: int) -> bytes:
    """dvs_msgs/EventArray as ROS 1 serialises it."""
    out = struct.pack("<IIII", 7, 1, 2, 3) + b"cam" + struct.pack("<III", height, width, len(events))
    for t, x, y, p in zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist()):
        out += struct.pack("<HHIIB", x, y, t // 10**9, t % 10**9, p)
    return out


def dvs_array_cdr(events: Events, width: int, height: int) -> bytes:
    """The same as CDR: every number aligned to its size, counted from behind the 4 bytes of the encapsulation."""
    out = bytearray(b"\x00\x01\x00\x00")

    def put(code: str, *values: int) -> None:
        for value in values:
            out.extend(bytes(-(len(out) - 4) % struct.calcsize(code)))
            out.extend(struct.pack("<" + code, value))

    put("I", 1, 2, 4)
    out.extend(b"cam\0")
    put("I", height, width, len(events))
    for t, x, y, p in zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist()):
        put("H", x, y)
        put("I", t // 10**9, t % 10**9)
        put("B", p)
    return bytes(out)


def event_packet(encoding: str, payload: bytes, width: int, height: int, seq: int, base_ns: int, cdr: bool) -> bytes:
    """event_camera_msgs/EventPacket."""
    out = bytearray(b"\x00\x01\x00\x00" if cdr else b"")
    start = len(out)

    def put(code: str, value: int) -> None:
        if cdr:
            out.extend(bytes(-(len(out) - start) % struct.calcsize(code)))
        out.extend(struct.pack("<" + code, value))

    def text(value: str) -> None:
        raw = value.encode() + (b"\0" if cdr else b"")
        put("I", len(raw))
        out.extend(raw)

    if not cdr:
        put("I", seq)
    put("I", 1)
    put("I", 2)
    text("cam")
    for code, value in zip("IIQQ", (height, width, seq, base_ns)):
        put(code, value)
    text(encoding)
    put("B", 0)
    put("I", len(payload))
    return bytes(out) + payload


def mono(events: Events, base_ns: int) -> bytes:
    """The `mono` encoding of event_camera_msgs."""
    rows = zip((events.t - base_ns).tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist())
    return b"".join(struct.pack("<Q", p << 63 | y << 48 | x << 32 | t) for t, x, y, p in rows)


def save(path: Path, data: bytes) -> Path:
    """A file of these bytes."""
    path.write_bytes(data)
    return path


def small_events(n: int = 120, width: int = 34, height: int = 34, seed: int = 1) -> Events:
    """Events in whole us, in order, on a small sensor."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.integers(0, 300, n)) * 1000 + 4000
    return Events.of(t, rng.integers(0, width, n), rng.integers(0, height, n), rng.integers(0, 2, n))
