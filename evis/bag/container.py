"""Writes an MCAP file so that what was written can be read whatever happens next.

Records go to the file by plain writes, nothing waits in a buffer of this process but the open chunk, and that is at
most 1 MB or 100 ms old. After a write that fails (full disk) the file is cut back to its last whole record and closed
with its index, as far as there is room for it.
"""

from __future__ import annotations

import contextlib
import os
import struct
import threading
import time
import zlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from evis.bag import BagError
from evis.bag.claim import claim

MAGIC = b"\x89MCAP0\r\n"
PROFILE = "ros2"
LIBRARY = "evis"
CHUNK_BYTES = 1 << 20
CHUNK_PERIOD_S = 0.1
ZSTD_LEVEL = 1
_IOV_MAX = 1000

Piece = bytes | bytearray | memoryview


def record_bytes(record: McapRecord) -> bytes:
    """One MCAP record with its opcode and length."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class Container:
    """An MCAP file being written. Safe to use from several threads. `backup`: where an older file went, or None."""

    def __init__(self, path: Path, chunk_bytes: int = CHUNK_BYTES, chunk_period_s: float = CHUNK_PERIOD_S) -> None:
        import zstandard

        self.path = path
        self.chunk_bytes, self.chunk_period_s = chunk_bytes, chunk_period_s
        self.end = 0
        """Bytes of whole records in the file."""
        self.failure: BagError | None = None
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = defaultdict(int)
        self._span: list[int] = []
        self._body = bytearray()
        self._indexes: dict[int, list[tuple[int, int]]] = {}
        self._compressed = True
        self._opened_at = 0.0
        self.closed = False
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._descriptor, self.backup = claim(path)
        try:
            self._write([MAGIC, record_bytes(Header(PROFILE, LIBRARY))])
        except BagError:
            self.close()
            raise
        self._flusher = threading.Thread(target=self._flush_in_time, name="bag-flush", daemon=True)
        self._flusher.start()

    # -- what is written outside of chunks ---------------------------------------------------------------------------

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Write a schema; its id."""
        with self._lock:
            schema = Schema(data=data, encoding=encoding, id=len(self._schemas) + 1, name=name)
            self.put(schema)
            return schema.id

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Write a channel; its id. Not in a chunk, so that no lost chunk takes it away."""
        with self._lock:
            channel = Channel(len(self._channels) + 1, topic, encoding, dict(metadata), schema)
            if channel.id > 0xFFFF:
                raise BagError(f"{self.path}: more than 65535 channels; record fewer topics or environments")
            self.put(channel)
            return channel.id

    def put(self, record: Schema | Channel) -> None:
        """Write a schema or channel under its own id."""
        with self._lock:
            self._write([record_bytes(record)])
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            else:
                self._channels[record.id] = record

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a named table of texts."""
        with self._lock:
            data = record_bytes(Metadata(name, dict(values)))
            self._metadata.append(MetadataIndex(self.end, len(data), name))
            self._write([data])

    # -- messages ----------------------------------------------------------------------------------------------------

    def add(self, messages: Sequence[tuple[int, int, int, Sequence[Piece]]], compress: bool = True) -> None:
        """Write messages (channel, sequence, log time [ns], pieces) that belong together into one chunk.

        The pieces are copied or written before this returns. Raises BagError, for a full disk too.
        """
        with self._lock:
            self._raise()
            if self._indexes and self._compressed != compress:
                self.flush()
            self._compressed = compress
            size = sum(len(p) for *_, pieces in messages for p in pieces)
            if not compress and size >= self.chunk_bytes:
                self.flush()
                pieces, _ = self._records(messages, 0)
                self._finish_chunk(pieces)
                return
            self._opened_at = self._opened_at if self._indexes else time.monotonic()
            pieces, _ = self._records(messages, len(self._body))
            for piece in pieces:
                self._body += piece
            self._wake.set()
            if len(self._body) >= self.chunk_bytes:
                self.flush()

    def _records(self, messages: Sequence[tuple[int, int, int, Sequence[Piece]]], at: int) -> tuple[list[Piece], int]:
        result: list[Piece] = []
        for channel, sequence, log_time, pieces in messages:
            length = 22 + sum(len(p) for p in pieces)
            head = struct.pack("<BQHIQQ", Opcode.MESSAGE, length, channel, sequence & 0xFFFFFFFF, log_time, log_time)
            result += [head, *pieces]
            self._indexes.setdefault(channel, []).append((log_time, at))
            at += 9 + length
        return result, at

    def flush(self) -> None:
        """Bring the open chunk to the file."""
        with self._lock:
            self._raise()
            if self._indexes:
                body, self._body = self._body, bytearray()
                self._finish_chunk([body])

    def _finish_chunk(self, pieces: list[Piece]) -> None:
        indexes, self._indexes = self._indexes, {}
        size, crc = sum(len(p) for p in pieces), 0
        for piece in pieces:
            crc = zlib.crc32(piece, crc)
        if self._compressed:
            self.put_chunk("zstd", size, crc, [self._compressor.compress(pieces[0])], indexes)
        else:
            self.put_chunk("", size, crc, pieces, indexes)

    def put_chunk(
        self, compression: str, size: int, crc: int, stored: Sequence[Piece], indexes: dict[int, list[tuple[int, int]]]
    ) -> None:
        """Write a chunk: its `stored` bytes, and for each channel the (log time, offset) of its messages."""
        name = compression.encode()
        count = sum(len(p) for p in stored)
        times = [t for entries in indexes.values() for t, _ in entries]
        first, last = min(times), max(times)
        head = struct.pack("<QQQII", first, last, size, crc, len(name)) + name + struct.pack("<Q", count)
        head = struct.pack("<BQ", Opcode.CHUNK, len(head) + count) + head
        start, length = self.end, len(head) + count
        offsets, tail = {}, b""
        for channel, entries in indexes.items():
            offsets[channel] = start + length + len(tail)
            tail += record_bytes(MessageIndex(channel, entries))
        self._write([head, *stored, tail])
        self._chunks.append(ChunkIndex(length, start, compression, count, last, len(tail), offsets, first, size))
        for channel, entries in indexes.items():
            self._counts[channel] += len(entries)
        self._span = [min([first, *self._span]), max([last, *self._span])]

    def _flush_in_time(self) -> None:
        while not self.closed:
            self._wake.wait()
            self._wake.clear()
            while not self.closed:
                with self._lock:
                    age = time.monotonic() - self._opened_at
                    if not self._indexes or self.failure:
                        break
                    if age >= self.chunk_period_s:
                        with contextlib.suppress(BagError):  # kept in `failure`, the next `add` raises it
                            self.flush()
                        break
                time.sleep(self.chunk_period_s - age)

    # -- the file ----------------------------------------------------------------------------------------------------

    def _raise(self) -> None:
        if self.failure:
            raise self.failure
        if self.closed:
            raise BagError(f"{self.path} is closed")

    def _write(self, pieces: Sequence[Piece]) -> None:
        """Write whole records, all or nothing. Raises BagError once and for all when the system refuses."""
        self._raise()
        try:
            self._write_all([memoryview(p).cast("B") for p in pieces if len(p)])
        except OSError as error:
            count = sum(self._counts.values())
            self.failure = BagError(
                f"{self.path}: {error.strerror} after {self.end / 1e6:.1f} MB; recording has stopped, "
                f"the {count} messages until then can be read"
            )
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self.end)
                os.lseek(self._descriptor, self.end, os.SEEK_SET)
            raise self.failure from None
        self.end += sum(len(p) for p in pieces)

    def _write_all(self, views: list[memoryview]) -> None:
        while views:
            written = os.writev(self._descriptor, views[:_IOV_MAX])
            while views and written >= len(views[0]):
                written -= len(views.pop(0))
            if written:
                views[0] = views[0][written:]

    def close(self) -> None:
        """Write the open chunk, the index and the end mark. After a failure: the index as far as it goes, no error."""
        with self._lock:
            if self.closed:
                return
            try:
                if not self.failure:
                    self.flush()
                failed, self.failure = self.failure, None
                with contextlib.suppress(BagError) if failed else contextlib.nullcontext():
                    self._write([self._summary()])
                self.failure = failed or self.failure
            finally:
                self.closed = True
                self._wake.set()
                os.close(self._descriptor)

    def _summary(self) -> bytes:
        """Everything from the end of the data to the end of the file (MCAP specification, `Summary Section`)."""
        data_end = record_bytes(DataEnd(0))
        start = self.end + len(data_end)
        statistics = Statistics(
            attachment_count=0, channel_count=len(self._channels), channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks), message_count=sum(self._counts.values()),
            message_start_time=self._span[0] if self._span else 0, message_end_time=self._span[1] if self._span else 0,
            metadata_count=len(self._metadata), schema_count=len(self._schemas),
        )  # fmt: skip
        groups: list[tuple[Opcode, Sequence[McapRecord]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())), (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [statistics]), (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, self._metadata),
        ]  # fmt: skip
        body, offsets = b"", []
        for opcode, records in groups:
            group = b"".join(record_bytes(r) for r in records)
            if group:
                offsets.append(SummaryOffset(opcode, start + len(body), len(group)))
            body += group
        offsets_start = start + len(body)
        body += b"".join(record_bytes(o) for o in offsets)
        crc = zlib.crc32(body + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start))
        return data_end + body + record_bytes(Footer(start, offsets_start, crc)) + MAGIC
