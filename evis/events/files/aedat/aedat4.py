"""Reads AEDAT 4.0 of DV: a flatbuffer header, packets of one stream each (compressed flatbuffers), and a table of
them."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from evis.events.arrays import Events
from evis.events.files.aedat import FAMILY
from evis.events.files.aedat.aedat4_packets import KINDS, Packets
from evis.events.files.aedat.flatbuffer import Table
from evis.events.files.reading.block_recording import BlockRecording, take_size
from evis.events.files.reading.decompress import DamagedError, inflate
from evis.events.recording import OpenOptions, RecordingError, RecordingInfo
from evis.files.allowance import Allowance
from evis.files.descriptor import DescriptorOwner
from evis.files.magic import LZ4, ZSTD

NAME = FAMILY

MAGIC = b"#!AER-DAT4.0\r\n"
COMPRESSIONS = {0: "none", 1: "lz4", 2: "lz4", 3: "zstd", 4: "zstd"}
_FRAME_MAGIC = {"lz4": LZ4, "zstd": ZSTD}
_MAX_HEADER = 16 << 20
_WINDOW = 1 << 20


class Packet(NamedTuple):
    """Locates a packet. `cut`: the file ends inside it."""

    at: int
    stream: int
    size: int
    cut: bool


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins with the signature, or the part of it that a cut left."""
    return head.startswith(b"#!AER-DAT4")


class Aedat4Recording(DescriptorOwner, BlockRecording):
    """Reads an AEDAT 4 file: events, triggers, IMU samples and frames in the order of its packets.

    A damaged packet is left out alone: it is counted as `packets_damaged` and named in the warnings. Packets of other
    kinds (poses, boxes, ...) are counted as `packets_left_out`. Of several cameras, one is read: the topic's.
    """

    own_packets = True

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path = path
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        self._buffer = memoryview(bytearray(_WINDOW))
        self._window = 0, self._buffer[:0]
        try:
            self._size = os.fstat(self._descriptor).st_size
            self.info = RecordingInfo(str(path), "aedat4", "", 0, 0, "header", self._size)
            self._read_header(options)
            self._place = self._begin
            if not take_size(self.info, options) and not self.info.width:
                self._size_from_events()
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _read_header(self, options: OpenOptions) -> None:
        info, table, length = self.info, -1, 0
        head = self._read(0, len(MAGIC) + 4)
        if len(head) == len(MAGIC) + 4 and head[: len(MAGIC)] == MAGIC:
            length = int.from_bytes(head[len(MAGIC) :], "little")
        self._begin, self._streams, self._compression = len(MAGIC) + 4 + length, {}, "none"
        self._of_others: set[int] = set()
        self._end = self._size
        if not length or length > _MAX_HEADER or self._begin > self._size:
            self._begin = self._size
            info.truncated = True
            info.warn("cut or damaged inside the header: there is no event")
            return
        try:
            root = Table.root(self._read(len(MAGIC), length + 4), b"IOHE")
            self._compression = COMPRESSIONS.get(root.integer(0, "i"), "")
            table = root.integer(1, "q", -1)
            self._streams = _streams(root.text(2))
        except DamagedError as error:
            raise RecordingError(f"{self._path}: damaged AEDAT 4 header: {error}") from None
        if not self._compression:
            raise RecordingError(f"{self._path}: AEDAT 4 with an unknown compression; known are none, LZ4 and Zstd")
        if self._begin <= table <= self._size:
            self._end = table
        if table > self._size:
            info.truncated = True
            info.warn("cut: its table of packets lies behind the end of the file")
        self._choose_stream(options)

    def _choose_stream(self, options: OpenOptions) -> None:
        """Chooses the stream of events: the one that was asked for, or the first. Raises RecordingError."""
        info = self.info
        events = {i: s for i, s in self._streams.items() if s.get("typeIdentifier") == "EVTS"}
        names = {str(i): i for i in events}
        for key in ("originalOutputName", "source"):  # a name that several streams have is none
            found = [s.get(key, "") for s in events.values()]
            names |= {name: i for name, i in zip(found, events) if name and found.count(name) == 1}
        info.topics = tuple(str(i) for i in events)
        if options.topic and options.topic not in names:
            raise RecordingError(
                f"{self._path}: no event stream '{options.topic}'; it has {', '.join(names) or 'none'}"
            )
        self._events_stream = names[options.topic] if options.topic else min(events, default=-1)
        if len(events) > 1 and not options.topic:
            there = (f"{i} ({', '.join(n for n, j in names.items() if j == i and n != str(i))})" for i in events)
            info.warn(f"event streams {', '.join(there)}: this is {self._events_stream}; name another as the topic")
        about = events.get(self._events_stream, {})
        # what belongs to another camera: its events, and all that names it as its source
        sources = {s.get("source", "") for i, s in events.items() if i != self._events_stream}
        sources -= {about.get("source", "")}
        self._of_others = {i for i, s in self._streams.items() if s.get("source") in sources}
        self._of_others |= events.keys() - {self._events_stream}
        width, height = (
            int(v) if re.fullmatch(r"\d{1,5}", v) else 0 for v in (about.get("sizeX", ""), about.get("sizeY", ""))
        )
        info.width, info.height = (width, height) if width and height else (0, 0)
        info.sensor, info.encoding = about.get("source", ""), self._compression
        info.serial = info.sensor.rpartition("_")[2] if "_" in info.sensor else ""

    def _read(self, at: int, size: int) -> memoryview:
        """Reads bytes of the file, fewer at its end. Valid until the next call, which uses the buffer again."""
        begin, window = self._window
        if size > _WINDOW:
            return memoryview(os.pread(self._descriptor, size, at))
        if not begin <= at <= at + size <= begin + len(window):
            begin, window = at, self._buffer[: os.preadv(self._descriptor, [self._buffer], at)]
            self._window = begin, window
        return window[at - begin : at - begin + size]

    # -- packets -----------------------------------------------------------------------------------------------------

    def _packets(self, at: int) -> Iterator[Packet]:
        while at < self._end:
            head = self._read(at, 20)
            stream, size = struct.unpack_from("<ii", head) if len(head) >= 8 else (-1, 0)
            known = size > 0 and (stream in self._streams or not self._streams)
            if known and at + 8 + size <= self._end and self._payload_begins_right(stream, head):
                yield Packet(at, stream, size, False)
                at += 8 + size
                continue
            following = self._next_packet(at + 1)
            if following < 0 and (self._end - at < 8 or (known and self._end == self._size)):
                yield Packet(at, stream, self._end - at - 8, True)
                return
            self._damaged(at, "its header is damaged")
            if following < 0:
                return
            at = following

    def _packet_kind(self, stream: int) -> bytes:
        """Returns the kind of a stream's packets that the header states, empty where it does not."""
        return self._streams.get(stream, {}).get("typeIdentifier", "").encode()

    def _payload_begins_right(self, stream: int, head: memoryview) -> bool:
        """Tells whether the bytes behind a packet's header are what the compression begins with."""
        magic = _FRAME_MAGIC.get(self._compression)
        if magic:
            return head[8:12] == magic
        kind = self._packet_kind(stream)
        return head[16:20] == kind if kind else head[16:20] in KINDS

    def _next_packet(self, at: int) -> int:
        """Finds the next place that looks like a packet's header, -1 where there is none."""
        magic = _FRAME_MAGIC.get(self._compression)
        kinds = {*KINDS, *filter(None, map(self._packet_kind, self._streams))}
        pattern = re.compile(re.escape(magic) if magic else b"|".join(map(re.escape, sorted(kinds))))
        behind = 8 if magic else 16
        while at < self._end:
            window = self._read(at, min(_WINDOW + 32, self._end - at))
            for found in pattern.finditer(window):
                start = at + found.start() - behind
                head = window[found.start() - behind : found.start() - behind + 8] if found.start() >= behind else b""
                if len(head) == 8:
                    stream, size = struct.unpack("<ii", head)
                    if 0 < size <= self._end - start - 8 and (stream in self._streams or not self._streams):
                        return start
            at += _WINDOW
        return -1

    def _damaged(self, at: int, why: str) -> None:
        self.count("packets_damaged")
        if self._counts["packets_damaged"] <= 3:
            self.info.warn(f"the packet at byte {at} is damaged and was left out: {why}")

    # -- events ------------------------------------------------------------------------------------------------------

    def _load(self) -> Iterator[Events]:
        return self._load_at(self._begin)

    def _load_at(self, at: int) -> Iterator[Events]:
        joined, allowance = Packets(), Allowance(self._size)
        for packet in self._packets(at) if at < self._size else ():
            self._place = packet.at + 8 + packet.size
            if packet.cut:
                self.info.truncated = True
                self.info.warn(f"cut inside the packet at byte {packet.at}")
            self._unpack(packet, joined, allowance)
            if joined.full:
                yield joined.take()
        if not joined.empty:
            yield joined.take()

    def _unpack(self, packet: Packet, joined: Packets, allowance: Allowance) -> None:
        if packet.size <= 0 or packet.stream in self._of_others:
            return
        if (kind := self._packet_kind(packet.stream)) and kind not in KINDS:
            self.count("packets_left_out")
            return
        try:
            data = inflate(self._compression, self._read(packet.at + 8, packet.size), allowance, packet.cut)
            joined.add(data, packet.cut)
        except DamagedError as error:
            if not packet.cut:
                self._damaged(packet.at, str(error))

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        """Yields blocks from a packet found in the table at the end of the file; without a table from the start."""
        if self._end == self._size or self._begin == self._size:
            return self._load()
        try:
            packed = self._read(self._end, self._size - self._end)
            data = inflate(self._compression, packed, Allowance(self._size), partial=True)
            rows = [(r.integer(0, "q"), r.integer(4, "q"), r) for r in Table.root(data, b"FTAB").tables(0)]
            streams = [int(np.frombuffer(r.data, "<i4", 1, r.place(1))[0]) if r.place(1) else 0 for *_, r in rows]
        except (DamagedError, ValueError):
            return self._load()
        places = []
        for wanted in set(streams) - self._of_others:
            mine = [(at, last) for (at, last, _), stream in zip(rows, streams) if stream == wanted]
            ends = np.array([last for _, last in mine], np.int64)
            i = int(np.searchsorted(ends, t_ns // 1000)) if (np.diff(ends) >= 0).all() else 0
            if i < len(mine):
                places.append(mine[i][0] - 8)
        # triggers, samples and frames have packets of their own, some before those of the events of their time
        at = min(places, default=rows[-1][0] - 8 if rows else self._begin)
        return self._load_at(at if self._begin <= at < self._end else self._begin)

    @property
    def position(self) -> float:
        return min(1.0, self._place / max(self._end if self._begin < self._size else 1, 1))


def _streams(text: str) -> dict[int, dict[str, str]]:
    """Parses the streams that the header's XML describes: number -> attributes of it and of its `info`."""
    if "<!" in text:
        raise DamagedError("its description has a document type")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise DamagedError(f"its description is no XML ({error})") from None
    streams = {}
    for node in root.iterfind("node[@name='outInfo']/node"):
        name = node.get("name", "")
        if re.fullmatch(r"\d{1,9}", name):
            attributes = [*node.iterfind("attr"), *node.iterfind("node[@name='info']/attr")]
            streams[int(name)] = {a.get("key", ""): a.text or "" for a in attributes}
    return streams


def open_file(path: Path, options: OpenOptions) -> Aedat4Recording:
    """Opens an AEDAT 4 file. Raises RecordingError."""
    return Aedat4Recording(path, options)
