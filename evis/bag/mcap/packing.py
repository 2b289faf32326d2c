"""Chunks compressed and checked by several threads. The bytes do not depend on how many there are.

Small chunks, and those of environments side by side, are the work of one thread each, several at once. A large one that
comes alone is cut up by zstd, within one frame.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

from evis.bag.mcap.checksum import crc32
from evis.bag.threads import ALONE, Threads

Piece = bytes | bytearray | memoryview

ZSTD_LEVEL = 1
LARGE = 1 << 20
"""A chunk of so many bytes is cut up, where it comes alone. Were it the number of threads that decided, the file would
depend on it.
"""
LARGEST = 4 << 20
"""A chunk of so many bytes is cut up where others come with it."""
_JOB = 1 << 19
"""Bytes of a chunk that one thread compresses at a time; zstd takes no less."""


class Packed(NamedTuple):
    """Holds what a chunk's record says of its messages: uncompressed bytes, their CRC-32, and what is stored."""

    compression: str
    size: int
    crc: int
    stored: Sequence[Piece]


class Packer:
    """Compresses chunks with zstd. threads: how many share the work."""

    def __init__(self, threads: Threads) -> None:
        self._threads = threads
        self._own = threading.local()
        self._shared: Any = None

    def many(self, bodies: Sequence[Piece]) -> list[Packed]:
        """Compresses chunks side by side."""
        return self._threads.map(self._whole, bodies)

    def _whole(self, body: Piece) -> Packed:
        import zstandard

        if not hasattr(self._own, "compressor"):
            self._own.compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        return Packed("zstd", len(body), crc32([body], ALONE)(), [self._own.compressor.compress(body)])

    def large(self, pieces: Sequence[Piece]) -> Packed:
        """Compresses one chunk, given in pieces, by all threads."""
        import zstandard

        if self._shared is None:
            # With workers, be it one, zstd cuts at the same bytes for any number of them; without, elsewhere.
            how = zstandard.ZstdCompressionParameters.from_level(ZSTD_LEVEL, threads=self._threads.count, job_size=_JOB)
            self._shared = zstandard.ZstdCompressor(compression_params=how)
        size, crc = sum(map(len, pieces)), crc32(pieces, self._threads)
        frame = self._shared.compressobj(size=size)
        stored = [frame.compress(piece) for piece in pieces]
        stored.append(frame.flush())
        return Packed("zstd", size, crc(), stored)

    def plain(self, pieces: Sequence[Piece]) -> Packed:
        """Leaves a chunk as it is."""
        return Packed("", sum(map(len, pieces)), crc32(pieces, self._threads)(), pieces)
