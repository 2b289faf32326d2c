"""Reads AEDAT 3.1 of cAER: a text header, then packets of one kind of event, little endian, uncompressed."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from evis.events.arrays import STANDARD_GRAVITY, Events, Frame, Imu, Triggers
from evis.events.files.aedat import FAMILY
from evis.events.files.aedat.aedat4_packets import SOURCES
from evis.events.files.reading.block_recording import BlockRecording, take_size
from evis.events.recording import HEAD, OpenOptions, RecordingError, RecordingInfo
from evis.files.descriptor import DescriptorOwner

NAME = FAMILY

END = b"#!END-HEADER\r\n"
SENSORS = {"DVS128": (128, 128), "DAVIS128": (128, 128), "DAVIS208": (208, 192), "DAVIS240": (240, 180),
           "DAVIS346": (346, 260), "DAVIS640": (640, 480), "DAVISRGB": (640, 480), "DVXPLORER": (640, 480)}  # fmt: skip
SPECIAL, POLARITY, FRAME, IMU6, IMU9 = range(5)
HEADER = np.dtype([("type", "<i2"), ("source", "<i2"), ("size", "<i4"), ("offset", "<i4"), ("overflow", "<i4"),
                   ("capacity", "<i4"), ("number", "<i4"), ("valid", "<i4")])  # fmt: skip
_PAIR = np.dtype([("data", "<u4"), ("t", "<i4")])
_FRAME = np.dtype([("info", "<u4"), ("times", "<i4", 4), ("size", "<i4", 2), ("place", "<i4", 2)])
_AS_AEDAT4 = {1: 0, 2: 1, 3: 2, 4: 3, 12: 4, 13: 5, 14: 6, 15: 7, 16: 8, 17: 9}
_EDGES = {code: SOURCES[source] for code, source in _AS_AEDAT4.items()}
"""Special event -> (id, value) of a trigger, ids as in AEDAT 4, which knows no second and third input (5 and 6)."""
_EDGES |= {first + i: (channel, value) for first, channel in ((6, 5), (9, 6)) for i, value in enumerate((1, 0, 1))}
_BY_CODE = np.array([_EDGES.get(code, (0, -1)) for code in range(128)], np.int8).T
_PART = 1 << 21
_MAX_FRAME = 64 << 20


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins with the signature."""
    return head.startswith(b"#!AER-DAT3")


class Aedat3Recording(DescriptorOwner, BlockRecording):
    """Reads an AEDAT 3.1 file: polarity events, special events, frames, IMU 6 and 9 of one source.

    The topic is the number of a source; by default the one of the first polarity events.
    """

    own_packets = True

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path, self._place = path, 0
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            header, self._begin = self._read_header()
            size = os.fstat(self._descriptor).st_size
            self.info = RecordingInfo(str(path), "aedat3", "raw", 0, 0, "header", size, header=header)
            if header.get("Format", "RAW") != "RAW":
                raise RecordingError(f"{path}: AEDAT 3.1 in the format {header['Format'][:30]}; known is RAW")
            named = {m[1]: v for k, v in header.items() if (m := re.fullmatch(r"-?Source (\d+)", k))}
            self._source_id = self._find_source(options.topic, named)
            source = named.get(str(self._source_id), next(iter(named.values()), ""))
            self.info.sensor = source
            family = next((s for name, s in SENSORS.items() if source.upper().startswith(name)), (0, 0))
            self.info.width, self.info.height = family
            if not self._begin:
                self._begin = size
                self.info.truncated = True
                self.info.warn("cut inside the header: there is no event")
            if not take_size(self.info, options) and not self.info.width:
                self._size_from_events(tuple(SENSORS.values()))
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _read_header(self) -> tuple[dict[str, str], int]:
        text = os.pread(self._descriptor, 1 << 20, 0)
        end = text.find(END)
        lines = text[: end if end >= 0 else HEAD].decode("latin-1").splitlines()
        found = [re.fullmatch(r"#([\w -]{1,40}):\s*(.*)", line.strip()) for line in lines]
        return {f[1].strip(): f[2].strip() for f in found if f}, end + len(END) if end >= 0 else 0

    def _find_source(self, topic: str, named: dict[str, str]) -> int | None:
        """Finds the source to read; None where there is no event."""
        self.info.topics = tuple(named)
        if topic:
            if topic not in named:
                there = ", ".join(f"{number} ({name})" for number, name in named.items())
                raise RecordingError(f"{self._path}: no source '{topic}'; it has {there or 'none'}")
            return int(topic)
        if not self._begin:
            return None
        first = next(
            (head for _, head in self._packets(self._begin, quiet=True) if int(head["type"]) == POLARITY), None
        )
        if first is not None and len(named) > 1:
            chosen, others = str(int(first["source"])), ", ".join(f"{n} ({name})" for n, name in named.items())
            self.info.warn(f"sources {others} in one file: read is {chosen}; name another as the topic")
        return None if first is None else int(first["source"])

    def _load(self) -> Iterator[Events]:
        return self._load_at(self._begin)

    def _packets(self, at: int, quiet: bool = False) -> Iterator[tuple[int, np.void]]:
        """Yields (place of the first event, header) of each packet; the last may be cut. quiet: without counts and
        warnings."""
        size = self.info.size_bytes
        while at < size:
            data = os.pread(self._descriptor, HEADER.itemsize, at)
            if len(data) < HEADER.itemsize:
                if not quiet:
                    self._cut(at)
                return
            head = np.frombuffer(data, HEADER)[0]
            length, number = int(head["size"]), int(head["number"])
            if not 0 < length <= _MAX_FRAME or number < 0 or not 0 <= int(head["type"]) < 64:
                if not quiet:
                    self.count("packets_damaged")
                    self.info.warn(f"the packet header at byte {at} is damaged; what follows cannot be found")
                return
            at += HEADER.itemsize
            if at + length * number > size and not quiet:
                self._cut(at)
            yield at, head
            at += length * number

    def _cut(self, at: int) -> None:
        self.info.truncated = True
        self.info.warn(f"cut inside the packet before byte {at}")

    def _load_at(self, at: int) -> Iterator[Events]:
        for start, head in self._packets(at):
            if self._source_id is not None and int(head["source"]) != self._source_id:
                self.count("packets_of_other_sources")
                continue
            length = int(head["size"])
            number = min(int(head["number"]), max(self.info.size_bytes - start, 0) // length)
            step = max(_PART // length, 1)
            for first in range(0, number, step):
                n = min(step, number - first)
                data = os.pread(self._descriptor, n * length, start + first * length)
                self._place = start + first * length
                if len(data) == n * length:
                    yield self._events(head, np.frombuffer(data, np.uint8).reshape(n, length))

    def _events(self, head: np.void, rows: np.ndarray) -> Events:
        """Converts the records of a packet, uint8 [n, size], to events, samples or frames."""
        events, kind, length = Events.empty(), int(head["type"]), rows.shape[1]
        least = {SPECIAL: 8, POLARITY: 8, FRAME: _FRAME.itemsize, IMU6: 36, IMU9: 48}.get(kind, 0)
        if length < least or not least:
            self.count("packets_damaged" if least else "packets_left_out")
            return events
        rows = rows[rows[:, 0] & 1 == 1]
        turns = np.int64(head["overflow"]) << 31
        if kind in (POLARITY, SPECIAL):
            pair = np.ascontiguousarray(rows[:, :8]).view(_PAIR)[:, 0]
            data, t = pair["data"], (pair["t"] + turns) * 1000
            if kind == POLARITY:
                x, y = (data >> 17).astype(np.uint16), (data >> 2 & 0x7FFF).astype(np.uint16)
                return Events(t, x, y, (data >> 1 & 1).astype(np.uint8))
            ids, values = _BY_CODE[:, data >> 1 & 0x7F]
            edge = values >= 0
            events.triggers = Triggers(t[edge], ids[edge].astype(np.uint8), values[edge].astype(np.uint8))
        elif kind == FRAME:
            events.frames = [f for f in (self._frame(r, turns) for r in rows) if f is not None]
        else:
            t = (np.ascontiguousarray(rows[:, 4:8]).view("<i4")[:, 0] + turns) * 1000
            values = np.ascontiguousarray(rows[:, 8:36]).view("<f4").astype(np.float64)
            events.imu = Imu(t, values[:, :3] * STANDARD_GRAVITY, np.radians(values[:, 3:6]), values[:, 6])
        return events

    def _frame(self, row: np.ndarray, turns: np.int64) -> Frame | None:
        head = np.frombuffer(row[: _FRAME.itemsize].tobytes(), _FRAME)[0]
        (width, height), channels = head["size"].tolist(), int(head["info"]) >> 1 & 7
        size = 2 * width * height * channels
        if width <= 0 or height <= 0 or channels not in (1, 3, 4) or _FRAME.itemsize + size > len(row):
            self.count("frames_damaged")
            return None
        values = row[_FRAME.itemsize :][:size].view("<u2").reshape(height, width, channels)
        pixels = values[..., 0] if channels == 1 else values[..., :3]
        t = [int(v) for v in (head["times"] + turns) * 1000]
        return Frame(t[0], pixels, t[2], t[3], int(head["place"][0]), int(head["place"][1]), t[1])

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        """Yields blocks from the last packet of events that begins before t_ns."""
        best = self._begin
        for start, head in self._packets(self._begin):
            if int(head["type"]) == POLARITY and int(head["size"]) >= 8:
                data = os.pread(self._descriptor, 8, start)
                first_us = int.from_bytes(data[4:], "little", signed=True) + (int(head["overflow"]) << 31)
                if len(data) == 8 and first_us * 1000 >= t_ns:
                    break
                best = start - HEADER.itemsize
        return self._load_at(best)

    @property
    def position(self) -> float:
        return min(1.0, self._place / max(self.info.size_bytes, 1))


def open_file(path: Path, options: OpenOptions) -> Aedat3Recording:
    """Opens an AEDAT 3.1 file. Raises RecordingError."""
    return Aedat3Recording(path, options)
