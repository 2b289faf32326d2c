"""Writes an MCAP file so that what was written can be read even after a crash.

Records go to the file by plain writes, nothing waits in a buffer of this process but the open chunk, and that is at
most 1 MB or 100 ms old: so much is lost when the process dies. Only chunks that are larger are compressed and written
in a thread of their own, where there may be one, while the next ones are made: at most `background_worker.MAX_BYTES`
bytes wait. What the system holds back from the disk is lost when the machine dies, unless the file is synced every
second (`sync`). After a write that fails (full disk) the file is cut back to its last whole record and closed with its
index, as far as there is room for it.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import stat
import struct
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from evis.bag import BagError
from evis.bag.mcap.background_worker import BackgroundWorker
from evis.bag.mcap.claim import claim
from evis.bag.mcap.marks import LIBRARY, MAGIC, PROFILE
from evis.bag.mcap.packing import LARGE, LARGEST, Packed, Packer, Piece
from evis.bag.mcap.summary import ChunkEntry, Summary, message_index, record_bytes
from evis.bag.mcap.sync import Syncer
from evis.bag.threads import ALONE, Threads
from evis.files.whole_file import written_at

CHUNK_BYTES = 1 << 20
CHUNK_PERIOD_S = 0.1
_AT_ONCE = 16
"""Chunks that threads compress side by side, few enough for the memory. Not the number of threads: what stands between
chunks, as channels do, would have other places with it.
"""
_IOV_MAX = 1000
_Indexes = dict[int, list[tuple[int, int]]]
"""Messages of a chunk by channel: (log time, offset) of each."""


class Container:
    """Writes an MCAP file. Safe to use from several threads. `backup`: where an older file went, or None.

    sync: bring it to the disk itself (fdatasync) once a second, from a thread. threads: share the compression; they
    have ended their part when `add` returns.
    """

    def __init__(
        self,
        path: Path,
        chunk_bytes: int = CHUNK_BYTES,
        chunk_period_s: float = CHUNK_PERIOD_S,
        sync: bool = False,
        threads: Threads = ALONE,
    ) -> None:
        self.path = path
        self.chunk_bytes, self.chunk_period_s = chunk_bytes, chunk_period_s
        self.end = 0
        """Bytes of whole records in the file."""
        self.failure: BagError | None = None
        self._packer = Packer(threads)
        self._failure_told = False
        self._summary = Summary()
        self._body = bytearray()
        self._indexes: _Indexes = {}
        self._threaded, self._worker = threads.count > 1, BackgroundWorker()
        self.cause: Exception | None = None
        """What the system refused, of which `failure` tells."""
        self._complete: list[tuple[Piece, _Indexes]] = []
        """Chunks that are complete and not yet written, within `together`."""
        self._together = False
        self._compressed = True
        self._opened_at = 0.0
        self.closed = False
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._descriptor, self.backup = claim(path)
        self.syncer: Syncer | None = None
        try:
            self._write([MAGIC, record_bytes(Header(PROFILE, LIBRARY))])
            if sync:
                self.syncer = self._started_syncer()
        except BagError:
            self.withdraw()
            raise
        self._flusher = threading.Thread(target=self._flush_in_time, name="bag-flush", daemon=True)
        if math.isfinite(chunk_period_s):  # without it chunks are as large as they are meant to be, whatever the time
            self._flusher.start()

    # -- what is written outside of chunks ---------------------------------------------------------------------------

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Writes a schema and returns its id."""
        with self._lock:
            schema = Schema(data=data, encoding=encoding, id=len(self._summary.schemas) + 1, name=name)
            self.put(schema)
            return schema.id

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Writes a channel and returns its id. It stands outside of chunks, so that no lost chunk takes it away."""
        with self._lock:
            channel = Channel(len(self._summary.channels) + 1, topic, encoding, dict(metadata), schema)
            if channel.id > 0xFFFF:
                raise BagError(f"{self.path}: more than 65535 channels; record fewer topics or environments")
            self.put(channel)
            return channel.id

    def put(self, record: Schema | Channel) -> None:
        """Writes a schema or channel under its own id."""
        with self._lock:
            self._write([record_bytes(record)])
            if isinstance(record, Schema):
                self._summary.schemas[record.id] = record
            else:
                self._summary.channels[record.id] = record

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Writes a named table of texts; bytes of a text that are not UTF-8, as in file names, are escaped."""
        table = {key: value.encode(errors="backslashreplace").decode() for key, value in values.items()}
        with self._lock:
            data = record_bytes(Metadata(name, table))
            self._write([data])
            self._summary.add_metadata(self.end - len(data), len(data), name)

    # -- messages ----------------------------------------------------------------------------------------------------

    def add(
        self, messages: Sequence[tuple[int, int, int, Sequence[Piece]]], compress: bool = True, given: bool = False
    ) -> None:
        """Writes messages (channel, sequence, log time [ns], pieces) that belong together into one chunk.

        The pieces are copied or written before this returns, unless they are `given`: then they must stay as they are.
        Raises BagError, for a full disk too; for a large chunk a later call does, or `close`.
        """
        with self._lock:
            self._raise_failure()
            if self._indexes and self._compressed != compress:
                self.flush()
            self._compressed = compress
            if not compress and sum(len(p) for *_, pieces in messages for p in pieces) >= self.chunk_bytes:
                self.flush()
            opened = not self._indexes
            self._opened_at = time.monotonic() if opened else self._opened_at
            pieces = self._records(messages, len(self._body))
            size = len(self._body) + sum(map(len, pieces))
            if size >= self.chunk_bytes and not (compress and self._for_one_thread(size)):
                if compress and self._threaded and not given:
                    pieces = [bytes(piece) for piece in pieces]
                self._end_chunk([self._body, *pieces])  # large arrays are not copied
                return
            for piece in pieces:
                self._body += piece
            if size >= self.chunk_bytes:
                self._end_chunk([self._body])
            elif opened:
                self._wake.set()

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Lets messages that are added within the block wait for one another, so that threads share their chunks."""
        with self._lock:
            self._together = True
            try:
                yield
            finally:
                self._together = False
                if not self.failure and not self.closed:
                    self._write_complete()

    def _records(self, messages: Sequence[tuple[int, int, int, Sequence[Piece]]], at: int) -> list[Piece]:
        result: list[Piece] = []
        for channel, sequence, log_time, pieces in messages:
            length = 22 + sum(len(p) for p in pieces)
            head = struct.pack("<BQHIQQ", Opcode.MESSAGE, length, channel, sequence & 0xFFFFFFFF, log_time, log_time)
            result += [head, *pieces]
            self._indexes.setdefault(channel, []).append((log_time, at))
            at += 9 + length
        return result

    def flush(self) -> None:
        """Writes the open chunk to the file."""
        with self._lock:
            self._raise_failure()
            if self._indexes:
                self._end_chunk([self._body])
            self._write_complete()
            self._worker.wait()
            self._raise_failure()

    def _end_chunk(self, pieces: list[Piece]) -> None:
        """Ends the open chunk, and writes it now or, within `together`, when there is work for all threads."""
        indexes, self._indexes, self._body = self._indexes, {}, bytearray()
        if self._compressed and self._for_one_thread(sum(map(len, pieces))):
            self._complete.append((pieces[0], indexes))
            if not self._together or len(self._complete) >= _AT_ONCE:
                self._write_complete()
            return
        self._write_complete()
        if self._compressed:
            self._raise_failure()
            packed, size = self._packer.large(pieces), sum(map(len, pieces))
            if self._threaded:
                self._worker.put(lambda: self._append(packed(), indexes), size)
            else:
                self._put_packed(packed(), indexes)
        else:
            self._put_packed(self._packer.plain(pieces), indexes)

    def _for_one_thread(self, size: int) -> bool:
        return size < (LARGEST if self._together else LARGE)

    def _write_complete(self) -> None:
        full, self._complete = self._complete, []
        for packed, (_, indexes) in zip(self._packer.many([body for body, _ in full]), full):
            self._put_packed(packed, indexes)

    def _put_packed(self, packed: Packed, indexes: _Indexes) -> None:
        self.put_chunk(packed.compression, packed.size, packed.crc, packed.stored, indexes)

    def put_chunk(self, compression: str, size: int, crc: int, stored: Sequence[Piece], indexes: _Indexes) -> None:
        """Writes a chunk: its `stored` bytes, and for each channel the (log time, offset) of its messages."""
        self._worker.wait()
        self._raise_failure()
        try:
            self._append(Packed(compression, size, crc, stored), indexes)
        except OSError as error:
            self._fail(error)
            self._raise_failure()

    def _append(self, packed: Packed, indexes: _Indexes) -> None:
        """Writes a chunk at the end of the file; only one thread may do so at a time. Raises OSError."""
        compression, size, crc, stored = packed
        name = compression.encode()
        count = sum(len(p) for p in stored)
        times = [t for entries in indexes.values() for t, _ in entries]
        first, last = min(times), max(times)
        head = struct.pack("<QQQII", first, last, size, crc, len(name)) + name + struct.pack("<Q", count)
        head = struct.pack("<BQ", Opcode.CHUNK, len(head) + count) + head
        tail = b"".join(message_index(channel, entries) for channel, entries in indexes.items())
        counts = {channel: len(entries) for channel, entries in indexes.items()}
        entry = ChunkEntry(self.end, len(head), count, first, last, size, compression, counts)
        self._write_all([head, *stored, tail])
        self._summary.add_chunk(entry)

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
                        self._flush_quietly()
                        break
                time.sleep(self.chunk_period_s - age)

    # -- the file ----------------------------------------------------------------------------------------------------

    def _raise_failure(self) -> None:
        error = self._worker.error
        if error is not None and error is not self.cause:
            self._fail(error)
        if self.failure:
            self._failure_told = True
            raise self.failure
        if self.closed:
            raise BagError(f"{self.path} is closed")

    def _write(self, pieces: Sequence[Piece]) -> None:
        """Writes whole records, all or nothing. After the first failure every call raises BagError."""
        self._worker.wait()
        self._raise_failure()
        try:
            self._write_all(pieces)
        except OSError as error:
            self._fail(error)
            self._raise_failure()

    def _fail(self, error: Exception) -> None:
        """Cuts the file back to its last whole record, and keeps the failure for the next call."""
        self.cause = error
        why = error.strerror if isinstance(error, OSError) else error
        self.failure = BagError(
            f"{self.path}: {why}"
            if isinstance(error, FileNotFoundError)
            else f"{self.path}: {why}; nothing could be written"
            if not self.end
            else f"{self.path}: {why} after {self.end / 1e6:.1f} MB; recording has stopped, "
            f"the {self._summary.messages} messages until then can be read"
        )
        with contextlib.suppress(OSError):
            os.ftruncate(self._descriptor, self.end)
            os.lseek(self._descriptor, self.end, os.SEEK_SET)

    def _write_all(self, pieces: Sequence[Piece]) -> None:
        views = [memoryview(p).cast("B") for p in pieces if len(p)]
        size = sum(map(len, views))
        while views:
            written = os.writev(self._descriptor, views[:_IOV_MAX])
            while views and written >= len(views[0]):
                written -= len(views.pop(0))
            if written:
                views[0] = views[0][written:]
        status = os.fstat(self._descriptor)
        if stat.S_ISREG(status.st_mode) and not status.st_nlink:  # a pipe may lose its name, and is read all the same
            raise FileNotFoundError(errno.ENOENT, "it was deleted while it was recorded, and is lost; record again")
        self.end += size

    def _started_syncer(self) -> Syncer:
        try:
            return Syncer(self._descriptor, self.path, self._written, self._sync_failed)
        except OSError as error:
            raise BagError(
                f"{self.path} cannot be synced to a disk ({error.strerror}); record to a file there, or without sync"
            ) from None

    def _written(self) -> int:
        with self._lock:
            self._flush_quietly()
            return self.end

    def _flush_quietly(self) -> None:
        """Flushes without raising, for a thread of its own: the next `add`, or `close`, raises what failed."""
        told = self._failure_told
        with contextlib.suppress(BagError):
            self.flush()
        self._failure_told = told

    def _sync_failed(self, error: OSError) -> None:
        # What the system could not bring to the disk it forgets: a later call that succeeds would promise too much.
        synced = self.syncer.synced if self.syncer else 0
        with self._lock:
            self.failure = self.failure or BagError(
                f"{self.path}: {error.strerror} while bringing it to the disk; recording has stopped, the first "
                f"{synced / 1e6:.1f} MB of {self.end / 1e6:.1f} MB are on the disk for certain"
            )

    def close(self) -> None:
        """Writes the open chunk, the index and the end mark; after a failure the index, as far as it goes.

        Raises BagError for a failure that nobody was told of.
        """
        if self.syncer:
            self.syncer.stop()
        with self._lock:
            if self.closed:
                return
            try:
                if not self.failure:
                    self._flush_quietly()
                self._worker.wait()
                failed, self.failure = self.failure, None
                with contextlib.suppress(BagError) if failed else contextlib.nullcontext():
                    self._write([*self._summary.pieces(self.end), MAGIC])
                self.failure = failed or self.failure
                self._finish_sync()
                if self.failure and not self._failure_told:
                    self._raise_failure()
            finally:
                self.closed = True
                self._wake.set()
                self._worker.close()
                self._packer.close()
                os.close(self._descriptor)

    def withdraw(self) -> None:
        """Closes and removes the file, and moves an older one of its name back to its place."""
        with contextlib.suppress(BagError):
            self.close()
        place = written_at(self.path)
        with contextlib.suppress(OSError):
            if self.backup:
                self.backup.replace(place)
            elif place.is_file():
                place.unlink()

    def _finish_sync(self) -> None:
        if self.syncer and not self.failure:
            try:
                self.syncer.sync()
            except OSError as error:
                self._sync_failed(error)
