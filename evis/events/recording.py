"""Reads recordings of events in one way, block by block or up to a time, whatever the file format."""

from __future__ import annotations

import abc
import contextlib
import importlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType, TracebackType
from typing import ClassVar

import numpy as np

from evis.config.suggestions import did_you_mean
from evis.events.arrays import Events
from evis.files.damage import faults_as
from evis.files.named_pipe import with_reader
from evis.files.whole_file import missing_folder, written_at

_FILES = "evis.events.files"
LATE_NS = 1_000_000_000
"""How much later than the events of their time a file may have triggers, inertial samples and frames: a frame comes
when it has been read out, a packet when it is full."""
FORMATS = (
    f"{_FILES}.prophesee.dat", f"{_FILES}.prophesee.raw", f"{_FILES}.text.zipped", f"{_FILES}.packed_file",
    f"{_FILES}.numpy_files.npz", f"{_FILES}.numpy_files.npy", f"{_FILES}.hdf5.reader", f"{_FILES}.aedat.aedat2",
    f"{_FILES}.aedat.aedat3", f"{_FILES}.aedat.aedat4", f"{_FILES}.es.reader", f"{_FILES}.rosbag.rosbag1",
    f"{_FILES}.rosbag.db3", "evis.bag.recording", f"{_FILES}.text.reader", f"{_FILES}.nmnist",
)  # fmt: skip
"""Modules with `NAME`, `matches(head, path)` and `open_file(path, options)`; recognised by content, in this order."""
_WITH_TOPICS = frozenset(
    {
        f"{_FILES}.hdf5.reader",
        f"{_FILES}.aedat.aedat3",
        f"{_FILES}.aedat.aedat4",
        f"{_FILES}.rosbag.rosbag1",
        f"{_FILES}.rosbag.db3",
        "evis.bag.recording",
        f"{_FILES}.text.zipped",
        f"{_FILES}.packed_file",
    }
)
WRITERS = {
    ".raw": "evis.events.files.prophesee.raw",
    ".npz": "evis.events.files.numpy_files.npz",
    ".csv": "evis.events.files.text.writer",
    ".txt": "evis.events.files.text.writer",
    ".dat": "evis.events.files.prophesee.dat",
    ".es": "evis.events.files.es.writer",
    ".aedat4": "evis.events.files.aedat.aedat4_writer",
    ".h5": "evis.events.files.hdf5.writer",
    ".hdf5": "evis.events.files.hdf5.writer",
}
"""Modules with `create(path, width, height, encoding)`, by extension."""
WHOLE_US = (".raw", ".dat", ".es", ".aedat4", ".h5", ".hdf5")
"""Extensions of formats that round times to whole us."""

HEAD = 4096
"""Bytes of a file that `matches` of a format sees."""


class RecordingError(ValueError):
    """Reports that a recording is missing, damaged or of an unknown kind. The text names the file and the remedy."""

    def __init__(self, text: str) -> None:
        # names inside a file can hold anything; the error is one line
        super().__init__("".join(c if c.isprintable() else "?" for c in text))


@dataclass(frozen=True)
class OpenOptions:
    """Holds what a user states about a file that the file itself does not say.

    backend: `numpy`, `warp` or `auto` (by size); same results. size: (width, height), in place of what the file says.
    topic: of a bag, an HDF5 file or an archive with several event streams, the one to read. name: what the file is
    called, which a few formats go by; an unpacked copy has no name of its own.
    """

    backend: str = "auto"
    size: tuple[int, int] | None = None
    topic: str = ""
    name: str = ""


@dataclass
class RecordingInfo:
    """Holds what a file states about itself.

    geometry_from: option, header, system_ID, file, sensor (size of the sensor that the format belongs to) or events
    (largest coordinates).
    """

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
    """The file is cut: all events before the cut are given. Known at the end of reading at the latest."""
    warnings: list[str] = field(default_factory=list)
    topics: tuple[str, ...] = ()
    """Event streams that `OpenOptions.topic` chooses among, where the format has such names."""

    def warn(self, text: str) -> None:
        """Adds a warning, each text once."""
        if text not in self.warnings:
            self.warnings.append(text)


class Recording(abc.ABC):
    """Reads a recording from start to end; a context manager. Times are those of the file, in ns."""

    info: RecordingInfo

    @abc.abstractmethod
    def blocks(self) -> Iterator[Events]:
        """Yields what is left in blocks of bounded size."""

    @abc.abstractmethod
    def read_until(self, t_ns: int) -> Events:
        """Reads the next events in file order, up to the first one later than t_ns."""

    def read_aside(self, t_ns: int) -> Events:
        """Reads on for triggers, inertial samples and frames up to t_ns that the file has behind later events.

        Returns them without events; what else is read on the way, up to LATE_NS behind t_ns, is left out.
        """
        return Events.empty()

    @abc.abstractmethod
    def seek(self, t_ns: int) -> None:
        """Continues with the first event or trigger, in file order, that is not earlier than t_ns; also backwards.

        By an index or bisection where the format allows it, otherwise by reading up to there.
        """

    @property
    @abc.abstractmethod
    def next_t_ns(self) -> int | None:
        """Returns the time of the next event or trigger, None at the end. Reads ahead where needed."""

    @property
    def raw(self) -> np.ndarray | None:
        """Returns the sensor's own bytes of the last `read_until` (uint8), None where the file does not hold them."""
        return None

    def counters(self) -> dict[str, int]:
        """Returns how much was dropped so far, by reason; only counts above 0."""
        return {}

    @property
    @abc.abstractmethod
    def position(self) -> float:
        """Returns the share of the file that has been read, 0 to 1."""

    @abc.abstractmethod
    def close(self) -> None:
        """Closes the file."""

    def read(self) -> Events:
        """Reads all that is left at once."""
        return Events.concatenate([Events.empty(), *self.blocks()])

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class Writer(abc.ABC):
    """Writes events to a file, which appears under its name only when it is complete. A context manager.

    keeps: what the format holds besides events, of triggers, imu and frames; the rest of a block is left out.
    """

    keeps: ClassVar[frozenset[str]] = frozenset()
    _settled = True
    """There is no partial file of its own: one of the same name would be another writer's."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._place = written_at(self.path)
        self.partial = self._place.with_name(f".{self._place.name}.{os.getpid()}.part")
        self._settled = False
        if missing := missing_folder(self.path):
            raise RecordingError(missing)

    @abc.abstractmethod
    def write(self, events: Events) -> None:
        """Appends events. Raises ValueError for what the format cannot hold."""

    @abc.abstractmethod
    def _finish(self) -> None:
        """Completes and closes the partial file."""

    def close(self) -> None:
        """Completes the file and gives it its name; copies it into a target that is no regular file (a pipe)."""
        self._finish()
        if self._place.exists() and not self._place.is_file():
            with with_reader(self._place), self.partial.open("rb") as whole, self._place.open("wb") as out:
                shutil.copyfileobj(whole, out)
            self.partial.unlink()
        else:
            os.replace(self.partial, self._place)
        self._settled = True

    def discard(self) -> None:
        """Removes the partial file."""
        self.partial.unlink(missing_ok=True)
        self._settled = True

    def __del__(self) -> None:
        # Interrupted between its opening and the block that would have closed it.
        if not self._settled:
            with contextlib.suppress(OSError):  # where its folder is a file there is none
                self.partial.unlink(missing_ok=True)

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        failure = error if isinstance(error, OSError) and error.filename is None else None
        try:
            if error is None:
                self.close()
        except OSError as e:
            failure = e
        try:
            self.discard()
        except (OSError, RuntimeError):  # the second by HDF5
            Writer.discard(self)  # to close it meant to write what no longer fits
        if failure is not None:
            raise RecordingError(f"{self.path}: writing failed: {reason(failure)}") from None


def open_recording(
    path: str | os.PathLike[str], backend: str = "auto", *, size: tuple[int, int] | None = None, topic: str = ""
) -> Recording:
    """Opens a recording; its content decides the format, not its name.

    backend, size, topic: as in `OpenOptions`. Raises RecordingError with one line that names the file, now and while
    the recording is read, and nothing else whatever is in the file.
    """
    path = Path(path)
    with faults_as(RecordingError, path):
        return open_as(path, OpenOptions(backend, size, topic, path.name))


def open_as(path: Path, options: OpenOptions) -> Recording:
    """Opens a recording as `open_recording` does, under the name that `options` states."""
    size, topic = options.size, options.topic
    if not path.exists():
        names = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        raise RecordingError(f"{path}: no such file{did_you_mean(path.name, names)}")
    bags = _bags_in(path) if path.is_dir() else []
    if bags:
        path, options = bags[0], replace(options, name=bags[0].name)
    if path.is_fifo():
        raise RecordingError(f"{path}: a pipe; recordings are read at more than one place: save it to a file first")
    if not path.is_file():
        raise RecordingError(f"{path}: not a file")
    if size is not None and not (0 < size[0] <= 65535 and 0 < size[1] <= 65535):
        raise RecordingError(f"{path}: a size of {size[0]}x{size[1]} is not possible (1 to 65535)")
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
    except OSError as e:
        raise RecordingError(f"{path}: cannot be read: {e.strerror}") from None
    if not head:
        raise RecordingError(f"{path}: the file is empty")
    modules = []
    for name in FORMATS:
        modules.append(importlib.import_module(name))
        if modules[-1].matches(head, path, options.name):
            if topic and name not in _WITH_TOPICS:
                raise RecordingError(f"{path}: {modules[-1].NAME} has no topics; leave out the topic '{topic}'")
            recording = modules[-1].open_file(path, options)
            if len(bags) > 1 and hasattr(recording, "more"):
                recording.more = bags[1:]
            elif len(bags) > 1:
                others = ", ".join(bag.name for bag in bags[1:])
                recording.info.warn(f"the bag is split: this is {path.name} alone; open the others too: {others}")
            return recording
    known = ", ".join(dict.fromkeys(m.NAME for m in modules))
    raise RecordingError(f"{path}: not a recording of a known format; known are {known}")


def _bags_in(folder: Path) -> list[Path]:
    """Lists the bag files of a folder that ROS 2 keeps as one bag, with a metadata.yaml."""
    if not (folder / "metadata.yaml").is_file():
        return []
    files = [p for p in folder.iterdir() if p.name.removesuffix(".zstd").endswith((".db3", ".mcap"))]
    return sorted(files, key=lambda p: (len(p.name), p.name))


def open_writer(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> Writer:
    """Opens a writer for the format of the path's extension.

    encoding, where the format has a choice: .raw evt3 (default), evt4, evt21, evt21_legacy, evt2; .aedat4 zstd
    (default), lz4, none; .h5 and .hdf5 ecf (default), plain, dsec.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise RecordingError(f"{path}: cannot write '{suffix}'; the extensions are {', '.join(WRITERS)}")
    module: ModuleType = importlib.import_module(WRITERS[suffix])
    try:
        return module.create(path, width, height, encoding)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {reason(error)}") from None


def reason(error: OSError) -> str:
    """Returns the system's own message of an error, without what a library wrote around it."""
    return os.strerror(error.errno) if error.errno else str(error)
