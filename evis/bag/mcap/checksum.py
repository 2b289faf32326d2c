"""Computes the CRC-32 of a chunk from blocks that threads check side by side, combined as zlib's crc32_combine does."""

from __future__ import annotations

import functools
import zlib
from collections.abc import Callable, Sequence

from evis.bag.threads import Threads

BLOCK = 1 << 20
"""Bytes that one thread checks at a time."""
_POLYNOMIAL = 0xEDB88320
"""Polynomial of CRC-32 with its bits in reverse: what the register becomes when a 1 leaves it."""


def crc32(pieces: Sequence[bytes | bytearray | memoryview], threads: Threads) -> Callable[[], int]:
    """Starts the CRC-32 of some pieces taken as one, and returns a function that waits for it."""
    views = [memoryview(piece).cast("B") for piece in pieces if len(piece)]
    whole = [view[at : at + BLOCK] for view in views for at in range(0, len(view) - BLOCK + 1, BLOCK)]
    blocks = threads.begin(zlib.crc32, whole)

    def result() -> int:
        crc, of_block = 0, iter(blocks())
        for view in views:
            count = len(view) // BLOCK
            for _ in range(count):
                crc = _apply(_block_matrix(), crc) ^ next(of_block)
            crc = zlib.crc32(view[count * BLOCK :], crc)
        return crc

    return result


@functools.cache
def _block_matrix() -> tuple[int, ...]:
    """Computes what each bit of a CRC becomes when BLOCK bytes follow: a matrix over GF(2).

    It is a power of the matrix of a single zero bit.
    """
    matrix: tuple[int, ...] = (_POLYNOMIAL, *(1 << bit for bit in range(31)))
    for _ in range((8 * BLOCK).bit_length() - 1):
        matrix = tuple(_apply(matrix, column) for column in matrix)
    return matrix


def _apply(matrix: tuple[int, ...], vector: int) -> int:
    result = 0
    for bit, column in enumerate(matrix):
        if vector >> bit & 1:
            result ^= column
    return result
