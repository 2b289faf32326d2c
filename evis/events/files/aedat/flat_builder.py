"""Writes the few shapes of flatbuffers that AEDAT 4 has, each number aligned to its size from the size prefix on."""

from __future__ import annotations

import struct

import numpy as np

_VECTOR = 28
"""Where the count of a root table's only vector is: behind prefix, root offset, identifier, vtable and table."""


def vector_of_structs(identifier: bytes, rows: np.ndarray) -> bytes:
    """Builds a size-prefixed root table whose only field is a vector of structs (8-byte aligned)."""
    return _prefixed(_head(identifier, len(rows)) + rows.tobytes())


def vector_of_tables(identifier: bytes, rows: np.ndarray, fields: list[int]) -> bytes:
    """Builds a vector as `vector_of_structs` does, of tables.

    rows: structs that begin with an int32 `table`, filled here; their size is a multiple of 8. fields: where each
    field of the schema is in such a row, 0 = not there.
    """
    n, size = len(rows), rows.dtype.itemsize
    vtable = struct.pack(f"<{2 + len(fields)}H", 4 + 2 * len(fields), size, *fields)
    vtable_at = _VECTOR + 4 + 4 * n
    first = -(-(vtable_at + len(vtable)) // 8) * 8
    places = first + size * np.arange(n, dtype=np.int64)
    rows = rows.copy()
    rows["table"] = places - vtable_at
    offsets = (places - (_VECTOR + 4 + 4 * np.arange(n, dtype=np.int64))).astype("<u4")
    body = offsets.tobytes() + vtable.ljust(first - vtable_at, b"\0") + rows.tobytes()
    return _prefixed(_head(identifier, n) + body)


def single_table(
    identifier: bytes, fields: list[tuple[str, float]], tail: bytes, align: int = 1
) -> tuple[bytes, list[int]]:
    """Builds a size-prefixed root table, and returns it with the place of each field. fields: (code as in `struct`,
    value); after them a vector of bytes, or a string where `tail` ends with a NUL that is not counted.
    """
    codes = sorted(range(len(fields)), key=lambda i: -struct.calcsize(fields[i][0]))
    vtable_at = 12
    table = -(-(vtable_at + 4 + 2 * (len(fields) + 1)) // 8) * 8 + 4
    places, at = [0] * len(fields), table + 4
    for i in codes:
        at = -(-at // struct.calcsize(fields[i][0])) * struct.calcsize(fields[i][0])
        places[i] = at
        at += struct.calcsize(fields[i][0])
    pointer = -(-at // 4) * 4
    count = pointer + 4 + -(pointer + 8) % align
    out = bytearray(count + 4)
    struct.pack_into("<I4s", out, 4, table - 4, identifier)
    offsets = [p - table for p in [*places, pointer]]
    struct.pack_into(f"<{2 + len(offsets)}H", out, vtable_at, 4 + 2 * len(offsets), pointer + 4 - table, *offsets)
    struct.pack_into("<i", out, table, table - vtable_at)
    for (code, value), place in zip(fields, places):
        struct.pack_into("<" + code, out, place, value)
    text = tail.endswith(b"\0") and identifier == b"IOHE"
    struct.pack_into("<I", out, pointer, count - pointer)
    struct.pack_into("<I", out, count, len(tail) - text)
    return _prefixed(bytes(out) + tail), places


def _head(identifier: bytes, count: int) -> bytes:
    return struct.pack("<II4sHHHHiII", 0, 16, identifier, 0, 6, 8, 4, 6, 4, count)


def _prefixed(data: bytes) -> bytes:
    data += bytes(-len(data) % 4)
    return struct.pack("<I", len(data) - 4) + data[4:]
