"""Reads event recordings in HDF5: Prophesee (ECF or not), DSEC, TUM-VIE, MVSEC and columns of x, y, t, p in general."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evis.events.arrays import Events
from evis.events.files.reading.block_recording import BlockRecording, take_size
from evis.events.files.reading.forked_trial import outcome_of
from evis.events.files.reading.unpacked_file import with_name
from evis.events.recording import OpenOptions, RecordingError, RecordingInfo

if TYPE_CHECKING:
    import h5py

    from evis.events.files.hdf5.cut import Parts
    from evis.events.files.hdf5.layouts import Layout

NAME = "HDF5 (Prophesee ECF, DSEC, TUM-VIE, MVSEC)"

MAGIC = b"\x89HDF\r\n\x1a\n"
_BLOCK = 1 << 18
_TRIED_WHOLE = 1 << 20
_MOST_MISSED = 10_000
"""Blocks in a row that lie behind the cut, after which no other is looked for."""


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether the signature stands at the start or behind a user block."""
    return any(head[at : at + 8] == MAGIC for at in (0, 512, 1024, 2048))


class Hdf5Recording(BlockRecording):
    """Reads an HDF5 file of one of the layouts of `layouts`.

    Of a file that is cut, the events whose data all lie before the cut: of a chunk of ECF or without compression that
    is cut, its first events; of one with another compression none. Columns that were written one after the other share
    no event until the last of them begins. Where what tells of the chunks lies behind the cut, they are lost too.
    """

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path, self._done = path, 0
        self.info = RecordingInfo(str(path), "hdf5", "", 0, 0, "", path.stat().st_size)
        self._file = self._open()
        from evis.events.files.hdf5.layouts import find_layout

        try:
            with self._named(self._cut()):
                self._layout: Layout = find_layout(self._file, options.topic, self.info, options.backend)
            self.info.encoding = self._layout.name
            if not take_size(self.info, options):
                with self._named():
                    found = self._layout.size()
                self.info.width, self.info.height, self.info.geometry_from = found
                if not self.info.width:
                    self._size_from_events()
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _open(self) -> h5py.File:
        import h5py

        stored = end_of_file(self._path)
        if stored > self.info.size_bytes:
            self.info.truncated = True
            self.info.warn(f"cut: the file has {self.info.size_bytes} of its {stored} bytes")
            self._source_file: Any = _PaddedFile(self._path, stored)
        else:
            self._source_file = None
        try:
            with with_name(self._path) as named:
                return h5py.File(self._source_file or named, "r")
        except (OSError, RuntimeError, ValueError, OverflowError) as error:
            if self.info.truncated:
                raise RecordingError(f"{self._path}: {self._cut()}") from None
            raise RecordingError(f"{self._path}: damaged HDF5 file ({_short(error)}); no event can be read") from None

    def _cut(self) -> str:
        at = f"it has {self.info.size_bytes} of its {end_of_file(self._path)} bytes"
        return f"cut before what tells where its events are ({at}); there is no event to be had"

    @contextlib.contextmanager
    def _named(self, cut: str = "this part lies behind the cut") -> Iterator[None]:
        """Converts errors of the library to one line with the file's name; of a file that is cut, `cut` in
        their place."""
        try:
            yield
        except RecordingError:
            raise
        except (OSError, RuntimeError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            if type(error).__module__.startswith("warp"):
                raise
            missing = "can't open directory" in str(error) or "filter" in str(error)
            if missing:
                text = "its compression is read by the package hdf5plugin: pip install 'evis[files]'"
                raise RecordingError(f"{self._path}: {text}") from None
            what = cut if self.info.truncated else _short(error)
            raise RecordingError(f"{self._path}: {what}") from None

    def _load(self) -> Iterator[Events]:
        yield from self._triggers()
        yield from self._load_at(0)

    def _triggers(self) -> Iterator[Events]:
        """Yields all triggers, which have a table of their own."""
        if self._layout.triggers is not None:
            with self._tolerant(), self._named():
                events = Events.empty()
                events.triggers = self._layout.triggers()
                yield events

    def _load_at(self, first: int) -> Iterator[Events]:
        layout, block = self._layout, self._layout.block or _BLOCK
        first -= first % block
        reached, missed = False, 0
        while first < layout.count:
            n = min(block, layout.count - first)
            self._done = first + n
            parts = [(first, first + n)]
            if self.info.truncated:
                parts = self._there(first, first + n)
            for a, b in parts:
                try:
                    with self._named():
                        events = layout.read(a, b)
                except RecordingError as error:
                    if not layout.block and not self.info.truncated:
                        raise
                    self._skip_damaged(a, error)
                else:
                    yield events
            if self.info.truncated and sum(b - a for a, b in parts) < n:
                place = self._place_of(first) if layout.read_cut is not None else None
                if layout.read_cut is not None and place is None and not reached:
                    yield from self._load_without_index(first)
                    return
                reached, missed = True, 0 if parts else missed + 1
                yield self._load_before_cut(parts, place, first, first + n)
            first += n
            if missed > _MOST_MISSED:
                self.count("events_behind_cut", max(layout.count - first, 0))
                return

    def _there(self, first: int, last: int) -> Parts:
        with self._named():
            return self._layout.there(self.info.size_bytes, first, last)

    def _place_of(self, first: int) -> tuple[int, int] | None:
        """Returns place and size of the chunk that begins with event `first`; None where that is lost."""
        try:
            chunk = self._layout.tables[0].id.get_chunk_info_by_coord((first,))
        except (RuntimeError, ValueError, OSError, OverflowError):
            return None
        return (chunk.byte_offset, chunk.size) if chunk.byte_offset is not None else None

    def _load_before_cut(self, parts: Parts, place: tuple[int, int] | None, first: int, last: int) -> Events:
        """Reads the events of a chunk before the cut that goes through it, and counts the others."""
        events, layout = Events.empty(), self._layout
        if layout.read_cut is not None and place is not None:
            with self._path.open("rb") as file, contextlib.suppress(RecordingError), self._named():
                file.seek(place[0])
                events = layout.read_cut(first, file.read(min(place[1], self.info.size_bytes)))[: last - first]
        self.count("events_behind_cut", last - first - sum(b - a for a, b in parts) - len(events))
        return events

    def _load_without_index(self, first: int) -> Iterator[Events]:
        """Yields chunks from event `first` on, whose index lies behind the cut, by the words that chunks begin with."""
        from evis.events.files.hdf5.cut import carve_ecf

        layout, info = self._layout, self.info
        info.warn("the index of its chunks lies behind the cut: they were found by what they begin with")
        before, t_us = self._place_of(first - layout.block) if first else None, None
        with contextlib.suppress(RecordingError), self._named():
            t_us = layout.time_at(first - 1) // 1000 if before else None
        found = 0
        size = (info.width, info.height)
        for t, x, y, p in carve_ecf(self._path, sum(before or ()), layout.block, t_us, size):
            found += len(t)
            yield Events(t * 1000, x, y, p)
        self.count("events_behind_cut", max(layout.count - first - found, 0))

    @contextlib.contextmanager
    def _tolerant(self) -> Iterator[None]:
        try:
            yield
        except RecordingError as error:
            self.info.warn(f"the triggers cannot be read: {error}")

    def _skip_damaged(self, first: int, error: RecordingError) -> None:
        """Counts a chunk that cannot be read, and warns of the first."""
        self.count("chunks_damaged")
        if self._counts["chunks_damaged"] == 1:
            why = str(error).removeprefix(f"{self._path}: ")
            self.info.warn(f"the chunk from event {first} on was left out: {why}")

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        """Yields blocks from an event found by bisection over single times; from the start where the file is cut."""
        low, high = 0, self._layout.count
        if self.info.truncated:
            return self._load()  # times behind the cut read as 0
        with contextlib.suppress(RecordingError), self._named():
            while high - low > _BLOCK:
                middle = (low + high) // 2
                if self._layout.time_at(middle) < t_ns:
                    low = middle
                else:
                    high = middle
        return itertools.chain(self._triggers(), self._load_at(low))

    def try_ends(self) -> None:
        """Reads a part of the first and of the last block. Raises RecordingError where they cannot be read."""
        next(self._triggers(), None)
        next(self._load_at(0), None)
        next(self._load_at(max(self._layout.count - 1, 0)), None)

    @property
    def position(self) -> float:
        return self._done / self._layout.count if self._layout.count else 1.0

    def close(self) -> None:
        with contextlib.suppress(AttributeError, RuntimeError, ValueError):
            self._file.close()
        if getattr(self, "_source_file", None) is not None:
            self._source_file.close()


class _PaddedFile(io.RawIOBase):
    """Extends a cut file by zeros to its full length, so that the library finds what is there."""

    def __init__(self, path: Path, size: int) -> None:
        self._descriptor, self._size, self._at = os.open(path, os.O_RDONLY | os.O_CLOEXEC), size, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = (0, self._at, self._size)[whence] + offset
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        n = max(min(len(view), self._size - self._at), 0)
        data = os.pread(self._descriptor, n, self._at) if 0 <= self._at < 1 << 62 else b""
        view[: len(data)] = data
        view[len(data) : n] = bytes(n - len(data))
        self._at += n
        return n

    def close(self) -> None:
        if not self.closed:
            os.close(self._descriptor)
        super().close()


def end_of_file(path: Path) -> int:
    """Returns where the file should end by its superblock (HDF5 file format 3.0, II.A); 0 where that is unknown."""
    with path.open("rb") as file:
        head = file.read(4096)
    at = next((a for a in (0, 512, 1024, 2048) if head[a : a + 8] == MAGIC), -1)
    if at < 0 or len(head) < at + 64:
        return 0
    version = head[at + 8]
    offsets = head[at + 13] if version < 2 else head[at + 9]
    place = {0: 24, 1: 28}.get(version, 12) + 2 * offsets
    if offsets != 8 or version > 3:
        return 0
    return int.from_bytes(head[at + place : at + place + 8], "little") & (1 << 62) - 1


def _short(error: BaseException) -> str:
    return str(error).replace("\n", " ")[:150] or type(error).__name__


def open_file(path: Path, options: OpenOptions) -> Hdf5Recording:
    """Opens an HDF5 recording. Raises RecordingError.

    The library checks little and can hang or crash on a damaged file: what may is first done in a process of its own,
    all of the reading for files up to 1 MB, opening and the first and last events for larger ones.
    """
    import evis.events.files.hdf5.layouts  # noqa: F401 (imported once, here, and not in the trial too)

    if end := outcome_of(lambda: _try(path, options)):
        raise RecordingError(f"{path}: damaged HDF5 file: its library {end} on it; no event can be read")
    return Hdf5Recording(path, options)


def _try(path: Path, options: OpenOptions) -> None:
    recording = Hdf5Recording(path, replace(options, backend="numpy"))
    if recording.info.size_bytes <= _TRIED_WHOLE:
        recording.read()
    else:
        recording.try_ends()
