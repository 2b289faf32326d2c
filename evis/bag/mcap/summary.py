"""Collects the index at the end of an MCAP file while the file is being written.

A recording of a day has a million chunks, so nothing of a chunk is kept as an object: what its index record will say
is packed, and whole blocks of that are compressed.
"""

from __future__ import annotations

import itertools
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

_BLOCK = 1 << 16
"""Bytes that are compressed together."""
_HEAD = struct.Struct("<QIQQQQBH")
"""Layout of a packed chunk entry: the fields of ChunkEntry, the compression by its number, the number of counts that
follow."""
_COUNT = struct.Struct("<HI")
"""A channel and its messages."""
MESSAGE_INDEX_HEAD, MESSAGE_INDEX_ENTRY = 9 + 2 + 4, 16
"""Bytes of a message index record: opcode, length, channel, length of the list; and of one message in it."""
_COMPRESSIONS = ("", "zstd", "lz4")


def record_bytes(record: McapRecord) -> bytes:
    """Encodes an MCAP record with its opcode and length."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def message_index(channel: int, entries: Sequence[tuple[int, int]]) -> bytes:
    """Makes the record that says where the messages of a channel are in the chunk before it: (log time, offset)."""
    size = MESSAGE_INDEX_ENTRY * len(entries)
    head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, MESSAGE_INDEX_HEAD - 9 + size, channel, size)
    return head + struct.pack(f"<{2 * len(entries)}Q", *itertools.chain.from_iterable(entries))


class Blocks:
    """Collects bytes, compressed in blocks; what is added in one call stays in one block."""

    def __init__(self) -> None:
        self.count = 0
        self._done: list[bytes] = []
        self._open = bytearray()

    def add(self, data: bytes) -> None:
        """Adds an entry."""
        self.count += 1
        self._open += data
        if len(self._open) >= _BLOCK:
            self._done.append(zlib.compress(self._open))  # zstandard's result keeps the room of the worst case
            self._open = bytearray()

    def __iter__(self) -> Iterator[bytes]:
        yield from map(zlib.decompress, self._done)
        yield bytes(self._open)


@dataclass(frozen=True)
class ChunkEntry:
    """Describes a chunk that has been written.

    start: of its record in the file; head, stored: bytes of the record before and of the messages; unpacked: their
    uncompressed bytes; counts: messages by channel, in the order of their index records.
    """

    start: int
    head: int
    stored: int
    first_ns: int
    last_ns: int
    unpacked: int
    compression: str
    counts: dict[int, int]

    def pack(self) -> bytes:
        """Packs the entry into few bytes."""
        kind = _COMPRESSIONS.index(self.compression)
        numbers = self.start, self.head, self.stored, self.first_ns, self.last_ns, self.unpacked, kind, len(self.counts)
        return _HEAD.pack(*numbers) + b"".join(_COUNT.pack(*item) for item in self.counts.items())

    def record(self) -> ChunkIndex:
        """Makes the record of the MCAP index. A message index stands behind the chunk for each channel."""
        length = self.head + self.stored
        at, offsets = self.start + length, {}
        for channel, count in self.counts.items():
            offsets[channel] = at
            at += MESSAGE_INDEX_HEAD + MESSAGE_INDEX_ENTRY * count
        tail = at - self.start - length
        return ChunkIndex(
            length, self.start, self.compression, self.stored, self.last_ns, tail, offsets, self.first_ns, self.unpacked
        )


def unpack(data: bytes) -> Iterator[ChunkEntry]:
    """Yields the entries of a block."""
    at = 0
    while at < len(data):
        start, head, stored, first, last, unpacked, kind, n = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        counts = dict(_COUNT.iter_unpack(data[at : at + n * _COUNT.size]))
        at += n * _COUNT.size
        yield ChunkEntry(start, head, stored, first, last, unpacked, _COMPRESSIONS[kind], counts)


class Summary:
    """Collects the index: schemas, channels, chunks, metadata, counts by channel and the span of times."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.messages = 0
        self._chunks, self._metadata = Blocks(), Blocks()
        self._counts: dict[int, int] = defaultdict(int)
        self._span = (0, 0)

    def add_metadata(self, at: int, size: int, name: str) -> None:
        """Adds a metadata record of `size` bytes at byte `at`."""
        self._metadata.add(record_bytes(MetadataIndex(at, size, name)))

    def add_chunk(self, chunk: ChunkEntry) -> None:
        """Adds a chunk to the index."""
        first, last = chunk.first_ns, chunk.last_ns
        self._span = (min(self._span[0], first), max(self._span[1], last)) if self.messages else (first, last)
        self._chunks.add(chunk.pack())
        for channel, count in chunk.counts.items():
            self._counts[channel] += count
            self.messages += count

    def pieces(self, end: int) -> list[bytes]:
        """Returns everything between the end of the data, at byte `end`, and the end mark (MCAP specification, Summary
        Section).

        Without the closing signature.
        """
        data_end = record_bytes(DataEnd(0))
        start = at = end + len(data_end)
        result, offsets = [], []
        for opcode, group in self._groups():
            size = sum(map(len, group))
            if size:
                offsets.append(SummaryOffset(opcode, at, size))
            result += group
            at += size
        result += [record_bytes(o) for o in offsets]
        crc = 0
        for piece in [*result, struct.pack("<BQQQ", Opcode.FOOTER, 20, start, at)]:
            crc = zlib.crc32(piece, crc)
        return [data_end, *result, record_bytes(Footer(start, at, crc))]

    def _groups(self) -> list[tuple[Opcode, list[bytes]]]:
        statistics = Statistics(
            attachment_count=0, channel_count=len(self.channels), channel_message_counts=dict(self._counts),
            chunk_count=self._chunks.count, message_count=self.messages, message_start_time=self._span[0],
            message_end_time=self._span[1], metadata_count=self._metadata.count, schema_count=len(self.schemas),
        )  # fmt: skip
        return [
            (Opcode.SCHEMA, [_joined(self.schemas.values())]),
            (Opcode.CHANNEL, [_joined(self.channels.values())]),
            (Opcode.STATISTICS, [record_bytes(statistics)]),
            (Opcode.CHUNK_INDEX, [_joined(entry.record() for entry in unpack(block)) for block in self._chunks]),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]


def _joined(records: Iterable[McapRecord]) -> bytes:
    return b"".join(record_bytes(r) for r in records)
