"""Decompresses data that may be damaged, cut or hostile: memory is bounded by a limit, not by what a file says."""

from __future__ import annotations

import bz2
from typing import Any

from evis.files.allowance import Allowance

LIMIT = 1 << 30
"""Most bytes that one packet or chunk may unpack to: it is in memory as a whole."""
_STEP = 16 << 20


class DamagedError(ValueError):
    """Reports that a packet or chunk cannot be unpacked or read.

    `partial`: what came out before, where that was asked for.
    """


def inflate(kind: str, data: bytes | memoryview, allowance: Allowance, partial: bool = False) -> bytes:
    """Unpacks `data`. kind: "" or none, lz4 (frame format), zstd, bz2. allowance: what the whole file may unpack to.

    partial: data that ends early, or is damaged, gives what comes before; otherwise it raises DamagedError. So does
    what unpacks to more than LIMIT bytes. Raises AllowanceError.
    """
    if kind in ("", "none"):
        return bytes(data)
    unpacker, own = _unpacker(kind), Allowance(len(data))
    parts: list[bytes] = []
    total, whole = 0, False
    pieces = unpacker(data)
    while True:
        try:
            part, done = next(pieces, (b"", None))
        except Exception as error:  # each library has its own
            if not partial:
                raise DamagedError(f"it cannot be unpacked ({kind}: {str(error)[:80]})") from None
            break
        if done is None:
            break
        own.take(len(part))
        allowance.take(len(part))
        parts.append(part)
        whole = done
        total += len(part)
        if total > LIMIT:
            raise DamagedError(f"it unpacks to more than {LIMIT} bytes")
    if not whole and not partial:
        raise DamagedError(f"its {kind} data end early")
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _unpacker(kind: str) -> Any:
    if kind == "bz2":
        return _bz2
    if kind == "zstd":
        return _zstd
    if kind != "lz4":
        raise DamagedError(f"its compression '{kind[:20]}' is not known")
    return _lz4


def _lz4(data: bytes | memoryview) -> Any:
    import lz4.frame

    # the call below the library's classes: those copy what is not bytes
    context, done = lz4.frame.create_decompression_context(), False
    while not done:
        part, used, done = lz4.frame.decompress_chunk(context, data, max_length=_STEP)
        yield part, done
        data = data[used:]
        if not len(data) or not (used or part):
            return


def _bz2(data: bytes) -> Any:
    unpacker = bz2.BZ2Decompressor()
    yield unpacker.decompress(data, _STEP), unpacker.eof
    while not unpacker.eof and not unpacker.needs_input:
        yield unpacker.decompress(b"", _STEP), unpacker.eof


def _zstd(data: bytes) -> Any:
    import zstandard

    # the reader does not tell a cut frame from a whole one: the size in the frame's header does, where it is there
    reader = zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(data)
    known = zstandard.get_frame_parameters(data).content_size
    total = 0
    while part := reader.read(_STEP):
        total += len(part)
        yield part, known == zstandard.CONTENTSIZE_UNKNOWN or total == known
    if not total:
        yield b"", known == 0
