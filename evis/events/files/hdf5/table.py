"""Reads datasets of an HDF5 file from that file alone, and no more of a chunk than the chunk has room for.

The library follows links into other files, reads data that are stored outside or put together from elsewhere, and lets
a compressed chunk unpack to whatever it unpacks to. So every object is found and every array read here.
"""

from __future__ import annotations

import bz2
import itertools
import math
import os
import zlib
from collections.abc import Callable
from typing import Any

import h5py

from evis.events.recording import RecordingError, RecordingInfo
from evis.files.allowance import Allowance

VARIABLE = "EVIS_OTHER_FILES"
"""Environment variable that allows a recording to name other files to be read: 1."""
_MOST_LINKS = 16
_STEP = 1 << 20
_HEAD = 16
"""Bytes of a chunk in which a filter of _TOLD says how much it unpacks to."""


def outside(info: RecordingInfo, name: str, what: str) -> None:
    """Raises RecordingError, unless other files may be read, for data that are not in the recording's own file."""
    if os.environ.get(VARIABLE, "") != "1":
        text = f"{name} is {what}, which is read only with {VARIABLE}=1 in the environment"
        raise RecordingError(f"{info.path}: {text}: a recording could name any file of yours")


class Table:
    """Reads a dataset of the file.

    Its attributes are the library's; `table[...]` checks the chunks that it takes first. spare: bytes that a chunk may
    unpack to beyond its room, so that small ones need not be unpacked twice.
    """

    def __init__(self, data: h5py.Dataset, info: RecordingInfo, spare: int = 0) -> None:
        self.data, self.id, self.name, self.dtype = data, data.id, str(data.name), data.dtype
        self.shape: tuple[int, ...] = data.shape or ()
        self.ndim, self.size = len(self.shape), math.prod(self.shape) if data.shape is not None else 0
        creation = data.id.get_create_plist()
        if creation.get_layout() == h5py.h5d.VIRTUAL:
            outside(info, self.name, "put together from other datasets (virtual)")
        elif creation.get_external_count():
            outside(info, self.name, f"stored in another file ({creation.get_external(0)[0].decode(errors='replace')})")
        self.chunks: tuple[int, ...] | None = data.chunks
        self.filters = [creation.get_filter(i)[0] for i in range(creation.get_nfilters())]
        self._room = math.prod(self.chunks) * self.dtype.itemsize if self.chunks else 0
        Allowance(info.size_bytes).check(self._room)
        self._most = self._room + spare
        self._checked: set[tuple[int, ...]] = set()

    @property
    def bytes(self) -> int:
        """Returns the size of the whole dataset in memory, unpacked."""
        return self.size * self.dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, which: Any) -> Any:
        if self.filters and self.chunks:
            rows = which[0] if isinstance(which, tuple) and which else which
            if isinstance(rows, int):
                rows = slice(rows, rows + 1)
            rows = rows if isinstance(rows, slice) else slice(None)
            first, last, _ = rows.indices(self.shape[0]) if self.shape else (0, 0, 1)
            self._check(first, last)
        return self.data[which]

    def _check(self, first: int, last: int) -> None:
        """Raises ValueError where a chunk of rows first..last-1 unpacks to more than it has room for."""
        assert self.chunks is not None
        length = self.chunks[0]
        rest = [range(0, side, step) for side, step in zip(self.shape[1:], self.chunks[1:])]
        corners = set(itertools.product(range(first - first % length, last, length), *rest))
        for corner in sorted(corners - self._checked):
            last = self.filters[-1]
            try:
                stored = self.id.get_chunk_info_by_coord(corner)
                if last not in _SIZES or not stored.size or stored.filter_mask >> (len(self.filters) - 1) & 1:
                    continue
                if stored.size * _LARGEST_RATIO.get(last, self._most + 1) <= self._most:
                    continue
                data = self._head(stored.byte_offset) if last in _TOLD else b""
                data = data or self.id.read_direct_chunk(corner)[1]
            except (RuntimeError, OSError, ValueError, KeyError):
                continue  # it is not there, which reading finds out
            if _SIZES[last](data, self._most) > self._most:
                size = f"{stored.size} bytes unpacks to more than its {self._room} bytes"
                raise ValueError(f"damaged: a chunk of {self.name} of {size}")
        self._checked = corners

    def _head(self, at: int) -> Any:
        """Reads the first bytes of a chunk; none where the library reads the file in another way, or counts from
        elsewhere."""
        file = self.data.file
        plain = file.driver == "sec2" and not file.userblock_size
        return os.pread(file.id.get_vfd_handle(), _HEAD, at) if plain else b""


def member(group: Any, name: str, info: RecordingInfo, links: int = 0, spare: int = 0) -> Table | h5py.Group | None:
    """Finds the object at a path from a group, None where there is none. Raises RecordingError for one of another
    file, AllowanceError for one whose chunks have too much room. spare: of a Table.
    """
    at = group["/"] if name.startswith("/") else group
    for part in name.split("/"):
        if part in ("", "."):
            continue
        try:
            link = at.id.links.get_info(part.encode())
            if link.type == h5py.h5l.TYPE_HARD:
                at = at[part]
                continue
            if link.type == h5py.h5l.TYPE_SOFT and links == _MOST_LINKS:
                return None
            if link.type == h5py.h5l.TYPE_SOFT:
                target = at.id.links.get_val(part.encode()).decode()
                found = member(at, target, info, links + 1)
                at = found.data if isinstance(found, Table) else found
            else:
                outside(info, f"{at.name.rstrip('/')}/{part}", "a link to another file")
                at = at[part]
        except (KeyError, RuntimeError, OSError, AttributeError, UnicodeError):
            return None
        if at is None:
            return None
    return Table(at, info, spare) if isinstance(at, h5py.Dataset) else at if isinstance(at, h5py.Group) else None


# -- what a chunk says that it unpacks to, or does: by the filter that is undone first ---------------------------------


def _unpacked(make: Callable[[], Any]) -> Callable[[bytes, int], int]:
    """Counts the bytes that come out, up to a little more than there is room for."""

    def size(data: bytes, room: int) -> int:
        unpacker, total = make(), 0
        try:
            while total <= room and not unpacker.eof:
                part = unpacker.decompress(data, _STEP)
                data = getattr(unpacker, "unconsumed_tail", b"")
                if not part:
                    break
                total += len(part)
        except (zlib.error, OSError, EOFError):
            return 0  # the library finds that too
        return total

    return size


def _told(at: int, length: int, order: Any) -> Callable[[bytes, int], int]:
    return lambda data, room: int.from_bytes(data[at : at + length], order)


def _of_zstd(data: bytes, room: int) -> int:
    import zstandard

    try:
        return max(zstandard.frame_content_size(data), 0)
    except zstandard.ZstdError:
        return 0


_SIZES: dict[int, Callable[[bytes, int], int]] = {
    1: _unpacked(zlib.decompressobj), 307: _unpacked(bz2.BZ2Decompressor), 32001: _told(4, 4, "little"),
    32026: _told(4, 4, "little"), 32004: _told(0, 8, "big"), 32008: _told(0, 8, "big"), 32015: _of_zstd,
}  # fmt: skip
"""By the number of the filter: deflate and bzip2 are unpacked to see, Blosc, Blosc 2, LZ4, bitshuffle and Zstandard
say it in their headers."""
_TOLD = (32001, 32026, 32004, 32008)
"""Those of them whose first bytes say it, so that no more of a chunk need be read twice."""
_LARGEST_RATIO = {1: 1032}
"""The most that a byte can unpack to, by the number of the filter."""
