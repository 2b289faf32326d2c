"""Finds the chunks of an MCAP file: by its index, or record by record where the index is missing or wrong.

Nothing in the file is believed: every length is checked against the bytes that are there before they are read.
"""

from __future__ import annotations

import itertools
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Header, McapRecord, Metadata, MetadataIndex, Schema, Statistics

from evis.bag import BagError
from evis.bag.mcap.marks import LIBRARY, MAGIC
from evis.files.allowance import Allowance, AllowanceError

MAX_CHUNK = 2 << 30
"""Largest uncompressed chunk that is opened [bytes]; no writer makes one nearly as large."""
_MAX_SMALL = 64 << 20
"""Largest record other than chunks and attachments."""
_MOST_OF_RUN = 16 << 20
"""Messages outside of chunks are read so many bytes at a time, and not all of a file that has no chunks."""
_KINDS: dict[int, type[McapRecord]] = {
    Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata,
    Opcode.CHUNK_INDEX: ChunkIndex, Opcode.METADATA_INDEX: MetadataIndex, Opcode.STATISTICS: Statistics,
    Opcode.FOOTER: Footer,
}  # fmt: skip
_FOOTER_BYTES = 9 + 20


@dataclass(frozen=True)
class Chunk:
    """Locates a chunk's records in the file.

    `at`, `size`: its stored bytes; `unpacked`: number of uncompressed bytes; `crc`: of those, 0 = unknown. channels:
    ids of the channels with messages in it, None = unknown.
    """

    at: int
    size: int
    compression: str
    unpacked: int
    crc: int
    start_ns: int
    end_ns: int
    channels: frozenset[int] | None = None


@dataclass
class Layout:
    """Describes where things are in the file. `problem`: why it is not whole, "" where it is."""

    library: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[Chunk] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    episodes: list[int] = field(default_factory=list)
    """File offsets where a new episode begins."""
    problem: str = ""
    cut: bool = False
    """The file ends before its data do."""


def parse(opcode: int, data: bytes | memoryview) -> Any:
    """Parses the bytes of a record; None for kinds that are not needed. Raises BagError."""
    kind = _KINDS.get(opcode)
    if kind is None:
        return None
    try:
        return kind.read(ReadDataStream(BytesIO(data)))  # type: ignore[attr-defined]
    except Exception as error:  # the library raises many unrelated types on damaged records
        raise BagError(f"a {Opcode(opcode).name.lower()} record is damaged ({type(error).__name__})") from None


def records(data: memoryview) -> Iterator[tuple[int, int, memoryview]]:
    """Yields (opcode, offset, body) of each record in the bytes of a chunk. Raises BagError."""
    at = 0
    while at < len(data):
        if at + 9 > len(data):
            raise BagError("a chunk ends within a record")
        opcode, length = data[at], int.from_bytes(data[at + 1 : at + 9], "little")
        if length > len(data) - at - 9:
            raise BagError("a chunk ends within a record")
        yield opcode, at, data[at + 9 : at + 9 + length]
        at += 9 + length


def message(body: memoryview) -> tuple[int, int, int, memoryview]:
    """Parses a message record's body: (channel, sequence, log time [ns], payload). Raises BagError."""
    if len(body) < 22:
        raise BagError("a message record is too short")
    channel, sequence, log_time = struct.unpack_from("<HIQ", body)
    return channel, sequence, log_time, body[22:]


OTHERS = {b"#ROSBAG": "a ROS 1 bag", b"SQLite f": "a ROS 2 bag of SQLite"}
"""First bytes of bags of other kinds -> the kind."""


class TooLargeError(BagError):
    """Reports that a chunk unpacks to more than it may; it is not damaged, and so not left out in silence."""


class Scanner:
    """Reads the structure and the chunks of an MCAP file. Raises BagError where it is no MCAP file at all."""

    def __init__(self, descriptor: int, name: str) -> None:
        self.descriptor, self.name = descriptor, name
        self.size = os.fstat(descriptor).st_size
        if not self.size:
            raise BagError(f"{name} is empty")
        head = self._read(0, len(MAGIC))
        if head != MAGIC:
            other = next((kind for begin, kind in OTHERS.items() if head.startswith(begin)), None)
            if other:
                raise BagError(f"{name} is {other}, no MCAP bag; `evis events info` and `convert` read its events")
            raise BagError(f"{name} is not an MCAP bag: it does not begin with the MCAP signature")
        try:
            indexed, problem = self._read_summary(), ""
        except BagError:
            indexed, problem = None, "its index is missing or damaged"
        self.layout = indexed or self._walked(problem)

    def _read(self, at: int, size: int) -> bytes:
        pieces = []
        while size > 0 and (piece := os.pread(self.descriptor, size, at)):
            pieces.append(piece)
            at, size = at + len(piece), size - len(piece)
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)

    def chunk_data(self, chunk: Chunk) -> memoryview:
        """Returns the uncompressed records of a chunk.

        Raises BagError where they are damaged, and TooLargeError for more bytes than may be unpacked.
        """
        if chunk.unpacked > MAX_CHUNK or chunk.size > MAX_CHUNK:
            raise BagError(f"a chunk claims {max(chunk.unpacked, chunk.size)} bytes, the limit is {MAX_CHUNK}")
        data = self._read(chunk.at, chunk.size)
        if len(data) != chunk.size:
            raise BagError("the file ends within a chunk")
        try:
            data = _decompress(chunk, data)
        except BagError:
            raise
        except AllowanceError as error:
            raise TooLargeError(f"{self.name}: a chunk of {error}") from None
        except Exception as error:  # each compressor has its own
            raise BagError(f"a chunk cannot be decompressed ({type(error).__name__})") from None
        if len(data) != chunk.unpacked:
            raise BagError("a chunk has not the size that it claims")
        if chunk.crc and zlib.crc32(data) != chunk.crc:
            raise BagError("a chunk's checksum is wrong")
        return memoryview(data)

    def stored(self, chunk: Chunk) -> bytes:
        """Returns the bytes of a chunk as they are in the file."""
        return self._read(chunk.at, chunk.size)

    # -- by index ----------------------------------------------------------------------------------------------------

    def _read_summary(self) -> Layout | None:
        """Reads the layout from the summary at the end; None where that is right and leaves out something of it.

        The MCAP specification lets a writer leave out every part, schemas and channels too, and the whole of it. Raises
        BagError where it is missing or damaged.
        """
        if self.size < 2 * len(MAGIC) + _FOOTER_BYTES:
            raise BagError("too short for a footer")
        tail = self._read(self.size - _FOOTER_BYTES - len(MAGIC), _FOOTER_BYTES + len(MAGIC))
        if tail[-8:] != MAGIC or tail[0] != Opcode.FOOTER:
            raise BagError("no footer")
        footer = parse(Opcode.FOOTER, tail[9:-8])
        start, end = footer.summary_start, self.size - _FOOTER_BYTES - len(MAGIC)
        if not start:
            return None
        if not start < end or end - start > _MAX_SMALL * 16:
            raise BagError("the footer is wrong")
        summary = self._read(start, end - start)
        if footer.summary_crc and zlib.crc32(tail[: _FOOTER_BYTES - 4], zlib.crc32(summary)) != footer.summary_crc:
            raise BagError("the summary's checksum is wrong")
        layout, tables, statistics = self._parse_summary(memoryview(summary), start)
        layout.chunks.sort(key=lambda c: c.at)
        if any(a.at + a.size > b.at for a, b in itertools.pairwise(layout.chunks)):
            raise BagError("it names a chunk many times, or one within another, each to be unpacked")
        if statistics is not None and 0 < len(layout.chunks) < statistics.chunk_count:
            raise BagError("it names some of the chunks")
        return layout if _is_full(layout, tables, statistics) else None

    def _parse_summary(self, summary: memoryview, start: int) -> tuple[Layout, int, Statistics | None]:
        """Reads the layout from the summary, which begins at byte `start`, the number of tables that it names, and its
        statistics, None where it has none. Raises BagError."""
        layout, statistics, tables, named = Layout(library=self._library()), None, 0, 0
        for opcode, _, body in records(summary):
            record = parse(opcode, body)
            if isinstance(record, Schema | Channel):
                self._add_record(layout, record, 0)
            elif isinstance(record, Statistics):
                statistics = record
            elif isinstance(record, MetadataIndex):
                opcode, data = self._record(record.offset, start)
                named += len(data)
                if named > start:
                    raise BagError("it names the same record many times")
                self._add_metadata(layout, parse(opcode, data), record.offset)
                tables += 1
            elif isinstance(record, ChunkIndex):
                channels = frozenset(record.message_index_offsets)
                layout.chunks.append(self._chunk(record.chunk_start_offset, start, channels or None))
        return layout, tables, statistics

    def _library(self) -> str:
        opcode, data = self._record(len(MAGIC), self.size)
        record = parse(opcode, data)
        return record.library if isinstance(record, Header) else ""

    def _record(self, at: int, end: int) -> tuple[int, bytes]:
        head = self._read(at, 9)
        length = int.from_bytes(head[1:], "little")
        if len(head) < 9 or length > min(_MAX_SMALL, end - at - 9):
            raise BagError(f"a record at byte {at} is damaged")
        return head[0], self._read(at + 9, length)

    def _chunk(self, at: int, end: int, channels: frozenset[int] | None) -> Chunk:
        head = self._read(at, 9 + 32 + 64)
        length = int.from_bytes(head[1:9], "little")
        if len(head) < 9 + 40 or head[0] != Opcode.CHUNK or length > end - at - 9 or length < 40:
            raise BagError(f"the chunk at byte {at} is damaged")
        start_ns, end_ns, unpacked, crc, name_length = struct.unpack_from("<QQQII", head, 9)
        stored_at = 9 + 32 + name_length
        if name_length > 16 or stored_at + 8 > 9 + length:
            raise BagError(f"the chunk at byte {at} is damaged")
        compression = head[9 + 32 : stored_at].decode(errors="replace")
        size = int.from_bytes(head[stored_at : stored_at + 8], "little")
        if stored_at + 8 + size != 9 + length:
            raise BagError(f"the chunk at byte {at} is damaged")
        return Chunk(at + stored_at + 8, size, compression, unpacked, crc, start_ns, end_ns, channels)

    @staticmethod
    def _add_metadata(layout: Layout, record: Any, at: int) -> None:
        if isinstance(record, Metadata):
            layout.metadata[record.name] = record.metadata
            if record.name == "episode":
                layout.episodes.append(at)

    # -- record by record --------------------------------------------------------------------------------------------

    def _walked(self, problem: str) -> Layout:
        """Reads the layout record by record. problem: what is wrong with a file that is whole up to its summary."""
        layout = Layout()
        at = len(MAGIC)
        bare: list[int] = []  # first byte and times of a run of messages outside of chunks
        try:
            while True:
                head = self._read(at, 9)
                length = int.from_bytes(head[1:], "little")
                layout.cut = len(head) < 9 or length > self.size - at - 9
                if layout.cut:
                    where = f"within the record at byte {at}" if head else f"at byte {at} without an end mark"
                    raise BagError(f"it ends {where}")
                opcode, following = head[0], at + 9 + length
                if opcode == Opcode.MESSAGE:
                    if bare and following - bare[0] > _MOST_OF_RUN:
                        bare = self._end_run(layout, bare, at)
                    log_time = int.from_bytes(self._read(at + 9 + 6, 8), "little")
                    first, low, high = bare or (at, log_time, log_time)
                    bare = [first, min(low, log_time), max(high, log_time)]
                else:
                    bare = self._end_run(layout, bare, at)
                    if opcode == Opcode.CHUNK:
                        layout.chunks.append(self._chunk(at, self.size, None))
                    elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
                        layout.problem = problem
                        break
                    elif opcode in _KINDS:
                        self._add_record(layout, parse(*self._record(at, self.size)), at)
                    elif not opcode:
                        raise BagError(f"there is no record at byte {at}")
                at = following
        except BagError as error:
            self._end_run(layout, bare, at)
            layout.problem = str(error)
        if layout.library != LIBRARY:
            self._read_definitions_in_chunks(layout)
        return layout

    @staticmethod
    def _end_run(layout: Layout, bare: list[int], at: int) -> list[int]:
        """Adds a run of messages outside of chunks as if it were an uncompressed chunk."""
        if bare:
            layout.chunks.append(Chunk(bare[0], at - bare[0], "", at - bare[0], 0, bare[1], bare[2]))
        return []

    def _add_record(self, layout: Layout, record: Any, at: int) -> None:
        """Adds a record to the layout."""
        if isinstance(record, Header):
            layout.library = record.library
        elif isinstance(record, Schema):
            layout.schemas[record.id] = record
        elif isinstance(record, Channel):
            layout.channels[record.id] = record
        else:
            self._add_metadata(layout, record, at)

    def _read_definitions_in_chunks(self, layout: Layout) -> None:
        """Reads schemas and channels from inside the chunks, where other writers keep them."""
        for chunk in layout.chunks:
            try:
                for opcode, _, body in records(self.chunk_data(chunk)):
                    if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                        self._add_record(layout, parse(opcode, body), chunk.at)
            except TooLargeError:
                raise
            except BagError:
                continue  # counted when its messages are read


def _is_full(layout: Layout, tables: int, statistics: Statistics | None) -> bool:
    """Tells whether a summary's layout, with so many tables of metadata, has all that the file has."""
    if statistics is None:
        named = frozenset[int]().union(*(chunk.channels or () for chunk in layout.chunks))
        schemas = {channel.schema_id for channel in layout.channels.values()} - {0}
        return bool(layout.chunks) and named <= layout.channels.keys() and schemas <= layout.schemas.keys()
    if statistics.message_count and not statistics.chunk_count:
        return False  # the messages stand outside of chunks
    found = len(layout.chunks), tables, len(layout.channels), len(layout.schemas)
    return found == (
        statistics.chunk_count, statistics.metadata_count, statistics.channel_count, statistics.schema_count,
    )  # fmt: skip


def _decompress(chunk: Chunk, data: bytes) -> bytes:
    if chunk.compression == "":
        return data
    allowance = Allowance(chunk.size)
    if chunk.compression == "zstd":
        import zstandard

        claimed = zstandard.get_frame_parameters(data).content_size
        if claimed not in (chunk.unpacked, zstandard.CONTENTSIZE_UNKNOWN):
            raise BagError("a chunk has not the size that it claims")
        allowance.check(chunk.unpacked)
        return zstandard.decompress(data, chunk.unpacked)
    if chunk.compression == "lz4":
        try:
            import lz4.frame  # noqa: F401 (only what it is called for)
        except ImportError:
            raise BagError("its chunks are compressed with lz4; install it with: pip install lz4") from None
        from evis.events.files.reading.decompress import inflate

        return inflate("lz4", data, allowance)
    raise BagError(f"its chunks are compressed with {chunk.compression!r}, which is not supported")
