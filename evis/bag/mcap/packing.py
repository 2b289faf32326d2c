"""Compresses and checks chunks with several threads; the bytes do not depend on their number.

Each is the work of one thread, several at once: small ones of environments side by side, and large ones that follow
each other while the graph goes on.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

from evis.bag.mcap.checksum import crc32
from evis.bag.threads import ALONE, Threads
from evis.files.allowance import BASE, RATIO

Piece = bytes | bytearray | memoryview

ZSTD_LEVEL = 1
LARGE = 1 << 20
"""A chunk of so many bytes is cut up, where it comes alone. Were it the number of threads that decided, the file would
depend on it.
"""
LARGEST = 4 << 20
"""A chunk of so many bytes is cut up where others come with it."""
_STORED = 1 << 18
"""Bytes of a large chunk's frame that are handed over at a time: it grows without being copied."""


class Packed(NamedTuple):
    """Holds what a chunk's record says of its messages: uncompressed bytes, their CRC-32, and what is stored."""

    compression: str
    size: int
    crc: int
    stored: Sequence[Piece]


class Packer:
    """Compresses chunks with zstd.

    threads: how many share the work. Large chunks have as many threads of their own, so that the next message need not
    wait for them.
    """

    def __init__(self, threads: Threads) -> None:
        self._threads = threads
        self._own = threading.local()
        self._cutters = Threads(threads.count)

    def many(self, bodies: Sequence[Piece]) -> list[Packed]:
        """Compresses chunks side by side."""
        return self._threads.map(self._whole, bodies)

    def _whole(self, body: Piece) -> Packed:
        import zstandard

        if not hasattr(self._own, "compressor"):
            self._own.compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        return Packed("zstd", len(body), crc32([body], ALONE)(), [self._own.compressor.compress(body)])

    def large(self, pieces: Sequence[Piece]) -> Callable[[], Packed]:
        """Starts to compress a chunk, given in pieces that must not change; the result waits for the end."""
        done = self._cutters.begin(self._cut_up, [pieces])
        return lambda: done()[0]

    def close(self) -> None:
        """Ends the threads of large chunks. A second call does nothing."""
        self._cutters.close()

    def _cut_up(self, pieces: Sequence[Piece]) -> Packed:
        import zstandard

        if not hasattr(self._own, "compressor"):
            self._own.compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        size = sum(map(len, pieces))
        chunker = self._own.compressor.chunker(size=size, chunk_size=_STORED)
        stored = [part for piece in pieces for part in chunker.compress(piece)]
        stored += chunker.finish()
        if size > BASE + RATIO * sum(map(len, stored)):  # readers would take it for a bomb, ours too
            return Packed("", size, crc32(pieces, ALONE)(), [bytes(piece) for piece in pieces])
        return Packed("zstd", size, crc32(pieces, ALONE)(), stored)

    def plain(self, pieces: Sequence[Piece]) -> Packed:
        """Packs a chunk without compression."""
        return Packed("", sum(map(len, pieces)), crc32(pieces, self._threads)(), pieces)
