"""Finds which part of a dataset lies before the end of a file that is cut.

The library itself gives zeros for what does not.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path

from evis.events.files.hdf5 import ecf
from evis.events.files.hdf5.ecf_layout import COUNT_SHIFT, MAX_SIDE, PACKED_COLUMNS, PACKED_EVENTS
from evis.events.files.hdf5.table import Table
from evis.events.files.reading.decompress import DamagedError

_WINDOW = 8 << 20
_LONGEST_CHUNK = 1 << 20
_LONGEST_PAUSE_US = 3_600_000_000

Parts = list[tuple[int, int]]
"""First row and the row behind the last, in order."""


def rows_there(table: Table, end: int, first: int, last: int) -> Parts:
    """Finds the rows of first..last-1 whose bytes all lie before byte `end` of the file.

    A compressed chunk counts as a whole. A chunk of which the index is lost counts as not there.
    """
    row = table.dtype.itemsize
    for side in table.shape[1:]:
        row *= side
    if table.chunks is None:
        begin = table.id.get_offset()
        return _joined([(first, min(last, (end - begin) // row))] if begin is not None else [])
    plain = table.id.get_create_plist().get_nfilters() == 0 and table.chunks[1:] == table.shape[1:]
    length, parts = table.chunks[0], []
    for start in range(first - first % length, last, length):
        try:
            places = [table.id.get_chunk_info_by_coord((start, *rest)) for rest in _column_offsets(table)]
        except (RuntimeError, ValueError, OSError, OverflowError):
            continue  # its index lies behind the cut
        if any(p.byte_offset is None or not p.size for p in places):
            continue
        stop = start + length
        if any(p.byte_offset + p.size > end for p in places):
            stop = start + (max(end - places[0].byte_offset, 0) // row if plain else 0)
        parts.append((max(start, first), min(stop, last)))
    return _joined(parts)


def _column_offsets(table: Table) -> list[tuple[int, ...]]:
    """Returns where the chunks of one row begin in the other dimension."""
    if table.ndim == 1 or table.chunks is None:
        return [()]
    return [(at,) for at in range(0, table.shape[1], table.chunks[1])]


def _joined(parts: Parts) -> Parts:
    out: Parts = []
    for first, last in parts:
        if first >= last:
            continue
        if out and out[-1][1] == first:
            out[-1] = out[-1][0], last
        else:
            out.append((first, last))
    return out


def common(one: Parts, other: Parts) -> Parts:
    """Intersects two lists of parts."""
    both = [(max(a, c), min(b, d)) for a, b in one for c, d in other]
    return [(a, b) for a, b in sorted(both) if a < b]


def carve_ecf(path: Path, at: int, length: int, t_us: int | None, size: tuple[int, int]) -> Iterator[ecf.Columns]:
    """Yields the ECF chunks in a file from byte `at` on, recognised by their first words: for a lost index.

    length: events in a chunk. t_us: time of the event before, None where there is none. size: of the sensor, 0 where it
    is unknown. A chunk counts when it can be decoded, no time steps back or leaps by more than an hour, and every pixel
    is on the sensor; of the one at the end of the file, what is there.
    """
    head = re.compile(
        b"|".join(
            re.escape(struct.pack("<I", length << COUNT_SHIFT | mode)) for mode in (0, PACKED_COLUMNS, PACKED_EVENTS)
        )
    )
    cut: ecf.Columns | None = None
    with path.open("rb") as file:
        while True:
            file.seek(at)
            data = file.read(_WINDOW)
            last = len(data) < _WINDOW
            end = len(data) if last else len(data) - _LONGEST_CHUNK
            place = 0
            while (found := head.search(data, place, end)) is not None:
                piece = data[found.start() : found.start() + _LONGEST_CHUNK]
                place = found.start() + 1
                start = int.from_bytes(piece[4:12], "little")
                if t_us is not None and not t_us <= start <= t_us + _LONGEST_PAUSE_US:
                    continue
                try:
                    columns, used = ecf.decode_some(piece)
                except DamagedError:
                    if last and cut is None and _plausible(some := ecf.decode_cut(piece), start, size):
                        cut = some
                    continue
                if _plausible(columns, start, size):
                    t_us, cut, place = int(columns[0][-1]), None, found.start() + used
                    yield columns
            if last:
                if cut is not None:
                    yield cut
                return
            at += max(place, end)


def _plausible(columns: ecf.Columns, start: int, size: tuple[int, int]) -> bool:
    t, x, y, _ = columns
    width, height = size[0] or MAX_SIDE, size[1] or MAX_SIDE
    in_time = len(t) > 0 and 0 <= start < 1 << 56 and int(t[-1]) - start <= _LONGEST_PAUSE_US
    return in_time and int(x.max()) < width and int(y.max()) < height
