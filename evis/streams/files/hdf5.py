"""Event recordings in HDF5: Prophesee (ECF or not), DSEC, TUM-VIE, MVSEC and columns of x, y, t, p in general."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evis.streams.events import Events
from evis.streams.files.blocks import BlockRecording, take_size
from evis.streams.recording import OpenOptions, RecordingError, RecordingInfo

if TYPE_CHECKING:
    import h5py

    from evis.streams.files.hdf5_layouts import Layout

NAME = "HDF5 (Prophesee ECF, DSEC, TUM-VIE, MVSEC)"

MAGIC = b"\x89HDF\r\n\x1a\n"
_BLOCK = 1 << 18


def matches(head: bytes, path: Path) -> bool:
    """The signature, at the start or behind a user block."""
    return any(head[at : at + 8] == MAGIC for at in (0, 512, 1024, 2048))


class Hdf5Recording(BlockRecording):
    """An HDF5 file of one of the layouts of `hdf5_layouts`. Of a file that is cut, what its library still finds.

    That is often nothing, although events lie before the cut: what tells where they are (a
    B-tree, the headers of the data sets) is written last.
    The library checks little: on a file damaged on purpose it can itself hang or crash.
    """

    def __init__(self, path: Path, options: OpenOptions) -> None:
        from evis.streams.files.hdf5_layouts import find_layout

        self._path, self._done = path, 0
        self.info = RecordingInfo(str(path), "hdf5", "", 0, 0, "", path.stat().st_size)
        self._file = self._open()
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
        try:
            import h5py
        except ImportError:
            raise RecordingError(f"{self._path}: HDF5 files need the package h5py: pip install 'evis[files]'") from None
        stored = end_of_file(self._path)
        if stored > self.info.size_bytes:
            self.info.truncated = True
            self.info.warn(f"cut: the file has {self.info.size_bytes} of its {stored} bytes")
            self._source_file: Any = _Padded(self._path, stored)
        else:
            self._source_file = None
        try:
            return h5py.File(self._source_file or self._path, "r")
        except (OSError, RuntimeError, ValueError, OverflowError) as error:
            if self.info.truncated:
                raise RecordingError(f"{self._path}: {self._cut()}") from None
            raise RecordingError(f"{self._path}: damaged HDF5 file ({_short(error)}); no event can be read") from None

    def _cut(self) -> str:
        at = f"it has {self.info.size_bytes} of its {end_of_file(self._path)} bytes"
        return f"cut before what tells where its events are ({at}); there is no event to be had"

    @contextlib.contextmanager
    def _named(self, cut: str = "this part lies behind the cut") -> Iterator[None]:
        """Errors of the library as one line with the file's name; of a file that is cut, `cut` in their place."""
        try:
            yield
        except RecordingError:
            raise
        except (OSError, RuntimeError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            if type(error).__module__.startswith("warp"):
                raise
            missing = "can't open directory" in str(error) or "filter" in str(error)
            remedy = "; its compression needs: pip install 'evis[files]'" if missing else ""
            what = cut if self.info.truncated and not missing else _short(error)
            raise RecordingError(f"{self._path}: {what}{remedy}") from None

    def _load(self) -> Iterator[Events]:
        return self._load_at(0)

    def _load_at(self, first: int) -> Iterator[Events]:
        layout, block = self._layout, self._layout.block or _BLOCK
        if first == 0 and layout.triggers is not None:
            with self._tolerant(), self._named():
                events = Events.empty()
                events.triggers = layout.triggers()
                yield events
        first -= first % block
        while first < layout.count:
            n = min(block, layout.count - first)
            self._done = first + n
            read: Callable[[int, int], Events] = layout.read
            try:
                with self._named():
                    events = read(first, first + n)
            except RecordingError as error:
                if not layout.block and not self.info.truncated:
                    raise
                self._lost(first, error)
            else:
                yield events
            first += n

    @contextlib.contextmanager
    def _tolerant(self) -> Iterator[None]:
        try:
            yield
        except RecordingError as error:
            self.info.warn(f"the triggers cannot be read: {error}")

    def _lost(self, first: int, error: RecordingError) -> None:
        """A chunk that cannot be read is left out alone."""
        self.count("chunks_damaged")
        if self._counts["chunks_damaged"] == 1:
            why = str(error).removeprefix(f"{self._path}: ")
            self.info.warn(f"the chunk from event {first} on was left out: {why}")

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        """Bisection over the times of single events."""
        low, high = 0, self._layout.count
        with contextlib.suppress(RecordingError), self._named():
            while high - low > _BLOCK:
                middle = (low + high) // 2
                if self._layout.time_at(middle) < t_ns:
                    low = middle
                else:
                    high = middle
        return self._load_at(low)

    @property
    def position(self) -> float:
        return self._done / self._layout.count if self._layout.count else 1.0

    def close(self) -> None:
        with contextlib.suppress(AttributeError, RuntimeError, ValueError):
            self._file.close()
        if getattr(self, "_source_file", None) is not None:
            self._source_file.close()


class _Padded(io.RawIOBase):
    """A cut file as long as it was: the library then finds what is there, and zeros where nothing is."""

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
    """Where the file should end by its superblock (HDF5 file format 3.0, II.A); 0 where that cannot be told."""
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
    """Open an HDF5 recording. Raises RecordingError."""
    return Hdf5Recording(path, options)
