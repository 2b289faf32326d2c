"""Recordings of events: one way to read them all, block by block or up to a time, whatever the file format."""

from __future__ import annotations

import abc
import difflib
import importlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, TracebackType

import numpy as np

from evis.streams.events import Events

FORMATS = ("evis.streams.raw", "evis.streams.npz")
"""Modules with `NAME`, `matches(head)` and `open_file(path, backend)`; recognised by content, in this order."""
WRITERS = {
    ".raw": "evis.streams.raw",
    ".npz": "evis.streams.npz",
    ".csv": "evis.streams.text",
    ".txt": "evis.streams.text",
}
"""Modules with `create(path, width, height, encoding)`, by extension."""

_OTHERS = {
    b"% Data file": "a Prophesee DAT recording",
    b"#!AER-DAT": "an AEDAT recording",
    b"Event Stream": "an Event Stream recording",
    b"\x89HDF": "an HDF5 file",
    b"\x89MCAP": "an MCAP bag (see `evis bag info`)",
    b"#ROSBAG": "a ROS 1 bag",
    b"SQLite format 3": "an SQLite file, perhaps a ROS 2 bag",
}


class RecordingError(ValueError):
    """A recording that is missing, damaged or of an unknown kind. The text names the file and the remedy."""


@dataclass
class RecordingInfo:
    """What a file says about itself. `geometry_from`: header, system_ID, file or events (largest coordinates)."""

    path: str
    format: str
    encoding: str
    width: int
    height: int
    geometry_from: str
    size_bytes: int = 0
    serial: str = ""
    sensor: str = ""
    header: dict[str, str] = field(default_factory=dict)
    truncated: bool = False
    """The file ends inside a word: all events before the cut are given."""
    warnings: list[str] = field(default_factory=list)


class Recording(abc.ABC):
    """An open recording, read once from start to end. A context manager; times as stored, in ns."""

    info: RecordingInfo

    @abc.abstractmethod
    def blocks(self) -> Iterator[Events]:
        """What is left, in blocks of bounded size."""

    @abc.abstractmethod
    def read_until(self, t_ns: int) -> Events:
        """The next events in file order, up to the first one later than t_ns."""

    @property
    @abc.abstractmethod
    def next_t_ns(self) -> int | None:
        """Time of the next event or trigger, None at the end. Reads ahead where needed."""

    @property
    def raw(self) -> np.ndarray | None:
        """The sensor's own bytes of the last `read_until` (uint8), None where the file does not hold such."""
        return None

    def counters(self) -> dict[str, int]:
        """What was dropped so far, by reason; only what is not 0."""
        return {}

    @property
    @abc.abstractmethod
    def position(self) -> float:
        """How much of the file has been read, 0 to 1."""

    @abc.abstractmethod
    def close(self) -> None:
        """Close the file."""

    def read(self) -> Events:
        """All that is left at once."""
        return Events.concatenate([Events.empty(), *self.blocks()])

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class BlockRecording(Recording):
    """A recording whose format gives blocks of events: `_load` yields them, this class cuts them by time."""

    def __init__(self) -> None:
        self._source = self._load()
        self._block = Events.empty()
        self._at = 0

    @abc.abstractmethod
    def _load(self) -> Iterator[Events]:
        """The file's events in blocks."""

    def _more(self) -> bool:
        """Make the current block one with unread events; False at the end."""
        while self._at >= len(self._block):
            block = next(self._source, None)
            if block is None:
                return False
            self._block, self._at = block, 0
        return True

    def blocks(self) -> Iterator[Events]:
        while self._more():
            part, self._at = self._block[self._at :], len(self._block)
            yield part

    def read_until(self, t_ns: int) -> Events:
        parts = [Events.empty()]
        while self._more():
            late = self._block.t[self._at :] > t_ns
            n = int(np.argmax(late)) if late.any() else len(late)
            parts.append(self._block[self._at : self._at + n])
            self._at += n
            if n < len(late):
                break
        return Events.concatenate(parts)

    @property
    def next_t_ns(self) -> int | None:
        return int(self._block.t[self._at]) if self._more() else None


class Writer(abc.ABC):
    """Writes events to a file, which appears under its name only when it is complete. A context manager."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.partial = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        if not self.path.parent.is_dir():
            raise RecordingError(f"{self.path}: the folder {self.path.parent} does not exist; make it first")

    @abc.abstractmethod
    def write(self, events: Events) -> None:
        """Append. Raises ValueError for what the format cannot hold."""

    @abc.abstractmethod
    def _finish(self) -> None:
        """Complete and close the partial file."""

    def close(self) -> None:
        """Complete the file and give it its name."""
        self._finish()
        os.replace(self.partial, self.path)

    def discard(self) -> None:
        """Leave nothing behind."""
        self.partial.unlink(missing_ok=True)

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if error is None:
                self.close()
        except OSError as e:
            raise RecordingError(f"{self.path}: writing failed: {e.strerror}") from None
        finally:
            self.discard()
        if isinstance(error, OSError) and error.filename is None:
            raise RecordingError(f"{self.path}: writing failed: {error.strerror}") from None


def open_recording(path: str | os.PathLike[str], backend: str = "auto") -> Recording:
    """Open a recording, whatever its name says: the content decides.

    backend: `numpy`, `warp` or `auto` (by size); same results. Raises RecordingError with one line that names the file.
    """
    path = Path(path)
    if not path.exists():
        names = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        near = difflib.get_close_matches(path.name, names, n=1)
        raise RecordingError(f"{path}: no such file" + (f"; did you mean {near[0]}?" if near else ""))
    if not path.is_file():
        raise RecordingError(f"{path}: not a file")
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as e:
        raise RecordingError(f"{path}: cannot be read: {e.strerror}") from None
    if not head:
        raise RecordingError(f"{path}: the file is empty")
    modules = [importlib.import_module(name) for name in FORMATS]
    for module in modules:
        if module.matches(head):
            return module.open_file(path, backend)
    raise RecordingError(f"{path}: {_what_is(head)}; supported are {', '.join(m.NAME for m in modules)}")


def open_writer(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> Writer:
    """A writer for the format of the path's extension. encoding: evt3 (default) or evt2, for .raw only."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise RecordingError(f"{path}: cannot write '{suffix}'; the extensions are {', '.join(WRITERS)}")
    module: ModuleType = importlib.import_module(WRITERS[suffix])
    return module.create(path, width, height, encoding)


def _what_is(head: bytes) -> str:
    for magic, name in _OTHERS.items():
        if head.startswith(magic):
            return f"this is {name}, which is not supported here"
    return "not a recording of a known format"
