"""Reads flatbuffers that may be damaged or hostile: every offset is checked against the bytes that are there."""

from __future__ import annotations

import functools
import itertools
import operator
import struct
from collections.abc import Sequence

import numpy as np

from evis.events.files.reading.decompress import DamagedError

_READERS = {code: struct.Struct(code) for code in ("<b", "<h", "<H", "<i", "<I", "<q", "<f")}
_OFFSET = np.dtype("<u4")

Wanted = tuple[tuple[int, str], ...]
"""Fields of a table: number and code as in `struct`."""
Rows = tuple[np.dtype, bytes]
"""Packed rows: their type, with fields named by number, and their bytes."""


class Table:
    """Reads one table of a buffer; fields by their number in the schema."""

    def __init__(self, data: bytes | memoryview, at: int) -> None:
        self.data, self.at = data, at
        vtable = at - _get("<i", data, at)
        size = _get("<H", data, vtable)
        if size < 4 or vtable < 0 or vtable + size > len(data):
            raise DamagedError("a flatbuffer table is damaged")
        self._fields = struct.unpack_from(f"<{(size - 4) // 2}H", data, vtable + 4)

    @staticmethod
    def root(data: bytes | memoryview, identifier: bytes, prefixed: bool = True) -> Table:
        """Returns the root table of a buffer with this identifier, size-prefixed or not."""
        at = 4 if prefixed else 0
        if bytes(data[at + 4 : at + 8]) != identifier:
            raise DamagedError(f"it does not hold {identifier.decode()}")
        return Table(data, at + _get("<I", data, at))

    def place(self, field: int) -> int:
        """Returns the place of a field's bytes, 0 where the table does not have it."""
        offset = self._fields[field] if field < len(self._fields) else 0
        return self.at + offset if offset else 0

    def number(self, field: int, code: str, default: float = 0) -> int | float:
        """Reads a number; code as in `struct`."""
        place = self.place(field)
        return _get("<" + code, self.data, place) if place else default

    def integer(self, field: int, code: str, default: int = 0) -> int:
        """Reads a whole number."""
        return int(self.number(field, code, default))

    def vector(self, field: int, dtype: np.dtype, cut: bool = False) -> np.ndarray:
        """Reads a vector of numbers or structs, not copied. cut: of a buffer that ends early, what is there."""
        place = self.place(field)
        if not place:
            return np.empty(0, dtype)
        place += _get("<I", self.data, place)
        n = _get("<I", self.data, place)
        there = (len(self.data) - place - 4) // dtype.itemsize
        if n > there and not cut:
            raise DamagedError("a flatbuffer vector is longer than its buffer")
        n = min(n, there)
        return np.frombuffer(self.data, dtype, n, place + 4)

    def text(self, field: int) -> str:
        """Reads a string."""
        return self.vector(field, np.dtype(np.uint8)).tobytes().decode(errors="replace")

    def tables(self, field: int, cut: bool = False) -> list[Table]:
        """Reads a vector of tables. cut: of a buffer that ends early, those that are there."""
        place = self.place(field)
        if not place:
            return []
        start = place + _get("<I", self.data, place) + 4
        offsets = self.vector(field, _OFFSET, cut).tolist()
        tables = []
        for i, offset in enumerate(offsets):
            try:
                tables.append(Table(self.data, start + 4 * i + offset))
            except DamagedError:
                if not cut:
                    raise
        return tables

    def rows(self, field: int, wanted: Wanted, cut: bool = False) -> Rows:
        """Returns the numbers of a vector of tables, a row for each table; fields that no table has are not in the
        rows' type.
        """
        place = self.place(field)
        start = place + _get("<I", self.data, place) + 4 if place else 0
        offsets = self.vector(field, _OFFSET, cut)
        tables = (start + np.arange(0, 4 * len(offsets), 4) + offsets).tolist()
        rows = self._alike(tables, wanted) if tables else None
        return self._one_by_one(tables, wanted, cut) if rows is None else rows

    def _alike(self, tables: list[int], wanted: Wanted) -> Rows | None:
        """Reads tables that have their fields in the same places, as writers make them; None where it is not so."""
        soffset, data = _READERS["<i"].unpack_from, self.data
        try:
            types = {at - soffset(data, at)[0] for at in tables}
            vtables = {bytes(data[v : v + _get("<H", data, v)]) for v in types}
        except (struct.error, DamagedError):
            return None
        kinds = {_row_type(vtable, wanted) for vtable in vtables}
        kind = kinds.pop() if len(kinds) == 1 else None
        if kind is None or max(tables) + kind.itemsize > len(data):
            return None
        size = kind.itemsize
        return kind, b"".join([data[at : at + size] for at in tables])

    def _one_by_one(self, tables: list[int], wanted: Wanted, cut: bool) -> Rows:
        readers = [(i, _READERS["<" + code].unpack_from) for i, code in wanted]
        known: dict[int, list[int]] = {}  # where the wanted fields are in a table, by its vtable
        rows = []
        try:
            for at in tables:
                vtable = at - _get("<i", self.data, at)
                if vtable not in known:
                    table = Table(self.data, at)
                    known[vtable] = [p - at if (p := table.place(i)) else 0 for i, _ in readers]
                rows.append(
                    tuple(read(self.data, at + o)[0] if o else 0 for o, (_, read) in zip(known[vtable], readers))
                )
        except (struct.error, DamagedError):
            if not cut:
                raise DamagedError("a flatbuffer table is damaged") from None
        kind = np.dtype([(str(i), "<" + code) for i, code in wanted])
        return kind, np.array(rows, kind).tobytes()


def columns(parts: Sequence[Rows], wanted: Wanted) -> list[np.ndarray]:
    """Joins the rows of many tables to one array for each wanted field; 0 where a field is absent."""
    tables = []
    for kind, alike in itertools.groupby(parts, operator.itemgetter(0)):
        tables.append(np.frombuffer(b"".join([data for _, data in alike]), kind))
    there = [[v[str(i)] if str(i) in (v.dtype.names or ()) else np.zeros(len(v), c) for v in tables] for i, c in wanted]
    return [column[0] if len(column) == 1 else np.concatenate(column) for column in there]


@functools.lru_cache(64)
def _row_type(vtable: bytes, wanted: Wanted) -> np.dtype | None:
    """Makes the record type of a table with this vtable, without fields that it lacks. None: the vtable is damaged."""
    if len(vtable) < 4:
        return None
    size, *offsets = struct.unpack_from(f"<{len(vtable) // 2 - 1}H", vtable, 2)
    there = [(str(i), "<" + code, offsets[i]) for i, code in wanted if i < len(offsets) and offsets[i]]
    end = max((at + np.dtype(code).itemsize for _, code, at in there), default=0)
    if not 0 < end <= size:
        return None
    names, formats, places = zip(*there)
    return np.dtype({"names": names, "formats": formats, "offsets": places, "itemsize": end})


def _get(code: str, data: bytes | memoryview, at: int) -> int:
    reader = _READERS[code]
    if at < 0 or at + reader.size > len(data):
        raise DamagedError("a flatbuffer points outside of its buffer")
    return reader.unpack_from(data, at)[0]
