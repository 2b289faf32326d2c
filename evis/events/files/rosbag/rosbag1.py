"""Reads ROS 1 bags (format 2.0) record by record, so that a bag without its index reads like any other."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path

from evis.events.files.reading.decompress import DamagedError, inflate
from evis.events.files.rosbag.messages import plain_type
from evis.events.files.rosbag.recording import BagMessage, RosRecording
from evis.events.recording import OpenOptions, RecordingError, RecordingInfo
from evis.files.allowance import Allowance
from evis.files.descriptor import DescriptorOwner

NAME = "ROS 1 bag"

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
_MAX_HEADER = 1 << 20
_MAX_DATA = 1 << 30


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins with the signature, of any version."""
    return head.startswith(b"#ROSBAG V")


class Rosbag1Recording(DescriptorOwner, RosRecording):
    """Reads a ROS 1 bag. Chunks may be compressed with bz2 or lz4; a chunk that is cut is read up to the cut."""

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path, self._place = path, 0
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            size = os.fstat(self._descriptor).st_size
            self.info = RecordingInfo(str(path), "rosbag1", "", 0, 0, "", size)
            if self._read(0, len(MAGIC)) != MAGIC:
                raise RecordingError(f"{path}: a ROS bag of another version than 2.0; convert it with `rosbag migrate`")
            self._connections: dict[int, tuple[str, str]] = {}
            self._begin(options)
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _read(self, at: int, size: int) -> bytes:
        return os.pread(self._descriptor, size, at)

    def _topics(self) -> dict[str, str]:
        """Reads the topics from the index; without one, the first event topic that is met will be the only one."""
        record = next(self._records(), None)
        position = record[1].get(b"index_pos", b"") if record and record[0] == HEADER else b""
        at = int.from_bytes(position, "little") if len(position) == 8 else 0
        if len(MAGIC) < at < self.info.size_bytes:
            for op, fields, start, size in self._records(at, quiet=True):
                if op != CONNECTION:
                    break
                self._connect(fields, self._read(start, min(size, _MAX_HEADER)))
        return {topic: kind for topic, kind in self._connections.values() if self._is_events(kind)}

    def _connect(self, fields: dict[bytes, bytes], data: bytes | memoryview) -> None:
        number = int.from_bytes(fields.get(b"conn", b""), "little")
        about = _fields(data) or {}
        topic, kind = (
            fields.get(b"topic", b"").decode(errors="replace"),
            about.get(b"type", b"").decode(errors="replace"),
        )
        self._connections[number] = topic, plain_type(kind)
        if not self.topic and self._is_events(self._connections[number][1]):
            self.topic = topic

    def _records(self, at: int = len(MAGIC), quiet: bool = False) -> Iterator[tuple[int, dict[bytes, bytes], int, int]]:
        """Yields (op, header fields, place of the data, bytes of the data); the last may be cut."""
        end = self.info.size_bytes
        while at < end:
            length = int.from_bytes(self._read(at, 4), "little")
            head = self._read(at + 4, length) if length <= _MAX_HEADER else b""
            size = self._read(at + 4 + length, 4)
            fields = _fields(head) if len(head) == length and length else None
            if fields is None or len(size) < 4:
                if not quiet:
                    self._lost(at, at + 8 + length > end and length <= _MAX_HEADER)
                return
            start, count = at + 8 + length, int.from_bytes(size, "little")
            self._place = at
            yield fields.get(b"op", b"\0")[0], fields, start, count
            at = start + count
        if at > end and not quiet:
            self.info.truncated = True

    def _lost(self, at: int, cut: bool) -> None:
        if cut:
            self.info.truncated = True
            self.info.warn(f"cut inside the record at byte {at}")
        else:
            self.count("records_damaged")
            self.info.warn(f"the record at byte {at} is damaged; what follows cannot be found")

    def _messages(self) -> Iterator[BagMessage]:
        allowance = Allowance(self.info.size_bytes)
        for op, fields, start, size in self._records():
            cut = start + size > self.info.size_bytes
            if op == CHUNK and size <= _MAX_DATA:
                try:
                    kind = fields.get(b"compression", b"none").decode("latin-1")
                    data = inflate(kind, self._read(start, size), allowance, cut)
                except DamagedError as error:
                    self.count("chunks_damaged")
                    self.info.warn(f"the chunk at byte {start} was left out: {error}")
                    continue
                yield from self._walk(memoryview(data), cut)
            elif op in (MESSAGE, CONNECTION) and size <= _MAX_DATA:
                yield from self._record(op, fields, memoryview(self._read(start, size)), cut)
            if cut:
                self.info.truncated = True
                self.info.warn(f"cut inside the record before byte {start}")

    def _walk(self, data: memoryview, cut: bool) -> Iterator[BagMessage]:
        at = 0
        while at + 4 <= len(data):
            length = struct.unpack_from("<I", data, at)[0]
            start = at + 8 + length
            fields = _fields(data[at + 4 : at + 4 + length]) if start <= len(data) else None
            if fields is None:
                if not cut:
                    self.count("chunks_damaged")
                    self.info.warn("a chunk is damaged inside; its rest was left out")
                return
            size = struct.unpack_from("<I", data, start - 4)[0]
            short = start + size > len(data)
            if short and not cut:
                self.count("chunks_damaged")
                self.info.warn("a chunk is damaged inside; its rest was left out")
                return
            yield from self._record(fields.get(b"op", b"\0")[0], fields, data[start : start + size], short)
            at = start + size

    def _record(self, op: int, fields: dict[bytes, bytes], data: memoryview, cut: bool) -> Iterator[BagMessage]:
        if op == CONNECTION:
            self._connect(fields, data)
        elif op == MESSAGE:
            topic, kind = self._connections.get(int.from_bytes(fields.get(b"conn", b""), "little"), ("", ""))
            if topic == self.topic and self._is_events(kind):
                yield BagMessage(kind, data, False, cut)

    @property
    def position(self) -> float:
        return min(1.0, self._place / max(self.info.size_bytes, 1))


def _fields(data: bytes | memoryview) -> dict[bytes, bytes] | None:
    """Parses the fields `name=value` of a record header; None where they do not add up."""
    fields, at = {}, 0
    while at < len(data):
        if at + 4 > len(data):
            return None
        length = struct.unpack_from("<I", data, at)[0]
        name, equals, value = bytes(data[at + 4 : at + 4 + length]).partition(b"=")
        at += 4 + length
        if at > len(data) or not equals:
            return None
        fields[name] = value
    return fields


def open_file(path: Path, options: OpenOptions) -> Rosbag1Recording:
    """Opens a ROS 1 bag. Raises RecordingError."""
    return Rosbag1Recording(path, options)
