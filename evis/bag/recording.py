"""Reads events of MCAP bags as recordings: ROS 2 (or ROS 1 messages in MCAP) from any recorder, and bags of EVIS."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path

from mcap.opcode import Opcode

from evis.bag import BagError
from evis.bag.mcap import scan
from evis.bag.mcap.container import LIBRARY
from evis.bag.mcap.scan import Scanner, TooLargeError
from evis.events.arrays import Events
from evis.events.files.reading.block_recording import BlockRecording, take_size
from evis.events.files.reading.decompress import DamagedError, inflate
from evis.events.files.rosbag.messages import TYPES, plain_type
from evis.events.files.rosbag.recording import BagMessage, RosRecording
from evis.events.recording import OpenOptions, Recording, RecordingError, RecordingInfo
from evis.files.allowance import Allowance
from evis.files.descriptor import DescriptorOwner

NAME = "MCAP bag"

_ENCODINGS = ("cdr", "ros1")


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins with the signature of MCAP."""
    return head.startswith(b"\x89MCAP")


class McapRecording(DescriptorOwner, RosRecording):
    """Reads an MCAP bag of another recorder. Without its index, or cut, it is read record by record."""

    def __init__(self, path: Path, options: OpenOptions, descriptor: int, scanner: Scanner) -> None:
        self._descriptor, self._scanner, self._place = descriptor, scanner, 0
        self.info = RecordingInfo(str(path), "mcap", "", 0, 0, "", scanner.size)
        self.info.header = {"library": scanner.layout.library}
        if scanner.layout.problem:
            self.info.truncated = scanner.layout.cut
            self.info.warn(f"torn: {scanner.layout.problem}")
        self._begin(options)
        super().__init__()

    def _topics(self) -> dict[str, str]:
        layout = self._scanner.layout
        self._channels: dict[int, tuple[str, str, bool]] = {}
        for number, channel in layout.channels.items():
            schema = layout.schemas.get(channel.schema_id)
            kind = plain_type(schema.name) if schema else ""
            if kind in TYPES and channel.message_encoding in _ENCODINGS:
                self._channels[number] = channel.topic, kind, channel.message_encoding == "cdr"
        return {topic: kind for topic, kind, _ in self._channels.values()}

    def _messages(self) -> Iterator[BagMessage]:
        wanted = {n for n, (topic, *_) in self._channels.items() if topic == self.topic}
        allowance = Allowance(self._scanner.size)
        for chunk in self._scanner.layout.chunks:
            self._place = chunk.at
            if chunk.channels is not None and not chunk.channels & wanted:
                continue
            try:
                data = self._scanner.chunk_data(chunk)
                allowance.take(len(data) if chunk.compression else 0)
                yield from self._walk(data, wanted, False)
            except TooLargeError:
                raise
            except BagError as error:
                self.count("chunks_damaged")
                self.info.warn(f"damaged chunks were left out: {error}")
        if self.info.truncated:
            yield from self._walk(memoryview(torn_tail(self._descriptor, self._scanner.size, allowance)), wanted, True)

    def _walk(self, data: memoryview, wanted: set[int], cut: bool) -> Iterator[BagMessage]:
        at = 0
        while at + 9 <= len(data):
            opcode, length = data[at], struct.unpack_from("<Q", data, at + 1)[0]
            body = data[at + 9 : at + 9 + length]
            if len(body) < length and not cut:
                raise BagError("a chunk ends within a record")
            if opcode == Opcode.MESSAGE and len(body) >= 22:
                number, *_, payload = scan.message(body)
                if number in wanted:
                    _, kind, cdr = self._channels[number]
                    yield BagMessage(kind, payload, cdr, len(body) < length)
            at += 9 + length

    @property
    def position(self) -> float:
        return min(1.0, self._place / max(self._scanner.size, 1))


def torn_tail(descriptor: int, size: int, allowance: Allowance) -> bytes:
    """Returns the records behind the last whole one of a file that ends early: of a cut chunk, unpacked, or a cut
    message."""
    at = 8
    while at + 9 <= size:
        head = os.pread(descriptor, 9, at)
        opcode, length = head[0], int.from_bytes(head[1:], "little")
        if at + 9 + length <= size:
            at += 9 + length
            continue
        data = os.pread(descriptor, min(size - at, 1 << 30), at)
        if opcode != Opcode.CHUNK:
            return data
        if len(data) < 9 + 40:
            return b""
        name_length = struct.unpack_from("<I", data, 9 + 28)[0]
        if name_length > 16 or len(data) < 9 + 40 + name_length:
            return b""
        name = data[9 + 32 : 9 + 32 + name_length].decode("latin-1")
        try:
            return inflate(name, data[9 + 40 + name_length :], allowance, partial=True)
        except DamagedError:
            return b""
    return b""


class EvisBagRecording(BlockRecording):
    """Reads the events of one topic of a bag that EVIS recorded."""

    def __init__(self, path: Path, options: OpenOptions) -> None:
        from evis.bag.reader import BagReader

        self._reader = BagReader(path)
        topics = self._event_topics()
        self.info = RecordingInfo(str(path), "mcap", "evis", 0, 0, "file", path.stat().st_size)
        self.info.topics = tuple(topics)
        try:
            if not topics:
                others = ", ".join(self._reader.topics)
                has = f"; its topics are {others}" if others else " and without any other topic"
                torn = f" (torn: {self._reader.problem})" if self._reader.problem else ""
                raise RecordingError(f"{path}: a bag without events{has}{torn}")
            if options.topic and options.topic not in topics:
                raise RecordingError(f"{path}: no events on '{options.topic}'; they are on {', '.join(topics)}")
            name = options.topic or next(iter(topics))
            self._topic, self._env = topics[name]
            if len(topics) > 1 and not options.topic:
                self.info.warn(f"events on {', '.join(topics)}: these are of {name}")
            if self._reader.problem:
                self.info.truncated = True
                self.info.warn(f"torn: {self._reader.problem}")
            self._stamp = self._reader.start_ns
            if not take_size(self.info, options):
                self._learn()
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _event_topics(self) -> dict[str, tuple[str, int | None]]:
        """Returns name -> topic and environment; each of several environments has a name, as in `evis bag info`."""
        topics: dict[str, tuple[str, int | None]] = {}
        for topic, kind in self._reader.topics.items():
            if kind == "EventPacket":
                numbers = sorted(
                    {s.env for s in self._reader.streams.values() if s.topic == topic and s.env is not None}
                )
                if len(numbers) > 1:
                    topics |= {f"/env{e}{topic}": (topic, e) for e in numbers}
                else:
                    topics[topic] = topic, None
        return topics

    def _learn(self) -> None:
        from evis.bag.decoded import decoded_events

        for packet, _ in decoded_events(self._reader, self._topic):
            self.info.width, self.info.height = packet.width, packet.height
            return

    def _load(self) -> Iterator[Events]:
        from evis.bag.decoded import decoded_events

        before = self._reader.skipped
        for packet, events in decoded_events(self._reader, self._topic, self._env):
            self._stamp = packet.header.stamp_ns
            yield events
        self.count("messages_damaged", self._reader.skipped - before)

    @property
    def position(self) -> float:
        start, end = self._reader.start_ns, self._reader.end_ns
        return min(max((self._stamp - start) / max(end - start, 1), 0.0), 1.0)

    def close(self) -> None:
        self._reader.close()


def open_file(path: Path, options: OpenOptions) -> Recording:
    """Opens an MCAP bag. Raises RecordingError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    ours = False
    try:
        scanner = Scanner(descriptor, str(path))
        ours = scanner.layout.library == LIBRARY
        if not ours:
            return McapRecording(path, options, descriptor, scanner)
    except BagError as error:
        os.close(descriptor)
        raise RecordingError(str(error)) from None
    except BaseException:
        os.close(descriptor)
        raise
    os.close(descriptor)
    try:
        return EvisBagRecording(path, options)
    except BagError as error:
        raise RecordingError(str(error)) from None
