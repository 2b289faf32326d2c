"""Converts the event messages of one topic to a recording, whatever the bag's container."""

from __future__ import annotations

import abc
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from evis.events.arrays import Events
from evis.events.codecs.decoder import decoder_for
from evis.events.files.reading.block_recording import BlockRecording, take_size
from evis.events.files.reading.decompress import DamagedError, inflate
from evis.events.files.rosbag.messages import PACKETS, TYPES, read_array, read_packet
from evis.events.recording import OpenOptions, RecordingError, open_recording
from evis.files.allowance import Allowance
from evis.files.magic import ZSTD

if TYPE_CHECKING:
    from evis.events.codecs.decoder import Decoder

_MAX_SIDE = 65535
_STREAMS = ("evt3", "evt2", "evt21")
_BATCH = 1 << 17
"""Bytes of messages that are decoded at once."""


@dataclass(frozen=True)
class BagMessage:
    """Holds a serialised message. cdr: as in ROS 2. cut: the file ends inside it."""

    type: str
    data: bytes | memoryview
    cdr: bool
    cut: bool = False


def unpacked(message: BagMessage, allowance: Allowance) -> BagMessage:
    """Unpacks a message that rosbag2 has compressed, known by its first bytes: no CDR begins as Zstandard does. Raises
    DamagedError and AllowanceError.
    """
    if not message.cdr or bytes(message.data[:4]) != ZSTD:
        return message
    return replace(message, data=inflate("zstd", bytes(message.data), allowance, message.cut))


class RosRecording(BlockRecording):
    """Reads the events of one topic of a bag. Damaged messages alone are left out, and counted.

    A subclass sets `info` and implements `_topics` and `_messages`, then calls `_begin`.
    """

    more: Sequence[Path] = ()
    """The other files of a bag that is split, read behind this one."""

    @abc.abstractmethod
    def _topics(self) -> dict[str, str]:
        """Returns the topics of event messages that are known from the start: name -> type (without /msg/)."""

    @abc.abstractmethod
    def _messages(self) -> Iterator[BagMessage]:
        """Yields the messages of `topic` in file order, from the start."""

    def _begin(self, options: OpenOptions) -> None:
        """Chooses the topic, and reads the sensor's size from its first message."""
        self.topic, self.backend = options.topic, options.backend
        self._counts = {}
        topics = self._topics()
        self.info.topics = tuple(topics)
        if options.topic and topics and options.topic not in topics:
            raise RecordingError(f"{self.info.path}: no events on '{options.topic}'; they are on {', '.join(topics)}")
        if not options.topic and topics:
            self.topic = next(iter(topics))
            if len(topics) > 1:
                self.info.warn(f"events on {', '.join(topics)}: these are of {self.topic}")
        self._learn(options.topic, topics)
        if not take_size(self.info, options) and not self.info.width:
            self._size_from_events()
        self._counts = {}

    def _learn(self, asked: str, topics: dict[str, str]) -> None:
        met = False
        for message in self._messages():
            met = True
            try:
                message = unpacked(message, Allowance(self.info.size_bytes))
                if message.type in PACKETS:
                    packet = read_packet(message.data, message.cdr, message.cut)
                    size, self.info.encoding = (packet.width, packet.height), packet.encoding
                else:
                    size = read_array(message.data, message.cdr, message.cut)[:2]
                    self.info.encoding = message.type.partition("/")[0]
            except DamagedError:
                continue
            if 0 < size[0] <= _MAX_SIDE and 0 < size[1] <= _MAX_SIDE:
                (self.info.width, self.info.height), self.info.geometry_from = size, "file"
            return
        if not met and asked and not topics:
            raise RecordingError(f"{self.info.path}: no events on '{asked}', nor on any other topic")

    def _load(self) -> Iterator[Events]:
        reader = _Reader(self)
        yield from self._decoded(reader, self._messages())
        for path in self.more:
            try:
                part = open_recording(path, size=(self.info.width, self.info.height), topic=self.topic)
            except RecordingError as error:
                self.info.warn(f"left out: {error}")
                continue
            with part:
                for warning in part.info.warnings:
                    self.info.warn(f"{path.name}: {warning}")
                if isinstance(part, RosRecording):
                    yield from self._decoded(reader, part._messages())
        yield from reader.flush()

    def _decoded(self, reader: _Reader, messages: Iterator[BagMessage]) -> Iterator[Events]:
        allowance = Allowance(self.info.size_bytes)
        for message in messages:
            try:
                if message.cut:
                    self.info.truncated = True
                    self.info.warn("cut inside a message")
                yield from reader.events(unpacked(message, allowance))
            except DamagedError as error:
                if not message.cut:
                    self.count("messages_damaged")
                    self.info.warn(f"damaged messages were left out: {error}")

    def _is_events(self, kind: str) -> bool:
        return kind in TYPES


class _Reader:
    """Decodes the messages of one topic, many at once: a sensor's own words continue from message to message."""

    def __init__(self, recording: RosRecording) -> None:
        self._recording = recording
        self._decoder: Decoder | None = None
        self._seq = -1
        self._dropped: dict[str, int] = {}
        self._waiting: list[bytes] = []
        self._bytes = 0

    def events(self, message: BagMessage) -> Iterator[Events]:
        """Yields the events of one message, at once or in a later call. Raises DamagedError, and RecordingError for an
        unknown encoding."""
        if message.type not in PACKETS:
            yield read_array(message.data, message.cdr, message.cut)[2]
            return
        packet = read_packet(message.data, message.cdr, message.cut)
        if packet.big_endian:
            raise DamagedError("big-endian events are not supported")
        if self._decoder is None or self._decoder.encoding != packet.encoding:
            yield from self.flush()
            self._decoder, self._dropped = self._make(packet.encoding), {}
        if 0 <= self._seq < packet.seq - 1:
            yield from self.flush()
            self._recording.count("messages_missing", packet.seq - 1 - self._seq)
            self._decoder.resync()
        self._seq = packet.seq
        if packet.encoding in _STREAMS:
            self._waiting.append(bytes(packet.events))
            self._bytes += len(packet.events)
            if self._bytes >= _BATCH:
                yield from self.flush()
        else:
            events = self._decoder.decode_packet(packet.events, packet.time_base_ns)
            self._tell()
            yield events

    def flush(self) -> Iterator[Events]:
        """Yields the events of the messages that wait."""
        if self._waiting and self._decoder is not None:
            data, self._waiting, self._bytes = b"".join(self._waiting), [], 0
            events = self._decoder.decode(data)
            self._tell()
            yield events

    def _make(self, encoding: str) -> Decoder:
        info, backend = self._recording.info, self._recording.backend
        try:
            return decoder_for(encoding, info.width, info.height, "numpy" if backend == "auto" else backend)
        except ValueError as error:
            raise RecordingError(f"{info.path}: {error}") from None

    def _tell(self) -> None:
        assert self._decoder is not None
        for name, total in self._decoder.counts.items():
            self._recording.count(f"events_{name}", total - self._dropped.get(name, 0))
            self._dropped[name] = total
