"""Events as a NumPy archive: arrays t (int64 ns), x, y (uint16), p (uint8), and optionally c, width and height.

Archives of any size are read and written in blocks; nothing is ever unpickled.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from evis.streams.events import Events
from evis.streams.files.blocks import BlockRecording
from evis.streams.recording import OpenOptions, RecordingError, RecordingInfo, Writer

NAME = "NumPy .npz of t, x, y, p"

_BLOCK = 1 << 20
_TYPES: dict[str, Any] = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8, "c": np.uint8}
# the same archive from the same events: no date in it
_DATE = (1980, 1, 1, 0, 0, 0)


def matches(head: bytes, path: Path) -> bool:
    """A zip archive."""
    return head.startswith((b"PK\x03\x04", b"PK\x05\x06"))


class NpzRecording(BlockRecording):
    """An archive of event arrays. Only the current block is in memory, also where the archive is compressed."""

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path, self._read = path, 0
        try:
            self._zip = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, OSError, NotImplementedError) as e:
            raise RecordingError(f"{path}: damaged or truncated .npz archive ({e})") from None
        try:
            self._check(options)
        except BaseException:
            self._zip.close()
            raise
        super().__init__()

    def _check(self, options: OpenOptions) -> None:
        path, names = self._path, {n.removesuffix(".npy") for n in self._zip.namelist()}
        missing = [n for n in "txyp" if n not in names]
        if missing:
            hint = "; it holds frames: use `evis events simulate`" if "luminance" in names else ""
            raise RecordingError(f"{path}: no array {', '.join(missing)} in the archive{hint}")
        self._columns = [n for n in "txypc" if n in names]
        lengths = {}
        for name in self._columns:
            with self._member(name) as (_, shape, dtype):
                if len(shape) != 1 or (dtype.kind not in "iu" and not (name == "p" and dtype.kind == "b")):
                    unit = " of ns" if name == "t" else ""
                    raise RecordingError(
                        f"{path}: {name} is {dtype} {list(shape)}, must be a flat array of whole numbers{unit}"
                    )
                lengths[name] = shape[0]
        if len(set(lengths.values())) != 1:
            raise RecordingError(f"{path}: arrays of different lengths: {lengths}")
        self._n = lengths["t"]
        width, height = self._scalar("width", names), self._scalar("height", names)
        source, warnings = "file", []
        if options.size:
            (width, height), source = options.size, "option"
        if not (width and height):
            width, height, source = self._largest("x"), self._largest("y"), "events"
            warnings.append(f"no width and height in the archive: {width}x{height} are the largest coordinates")
        size = path.stat().st_size
        self.info = RecordingInfo(str(path), "npz", "", width, height, source, size, warnings=warnings)

    def _member(self, name: str) -> _Member:
        return _Member(self._path, self._zip, name)

    def _scalar(self, name: str, names: set[str]) -> int:
        if name not in names:
            return 0
        with self._member(name) as (file, shape, dtype):
            if shape != () or dtype.kind not in "iu":
                return 0
            value = int(np.frombuffer(file.read(dtype.itemsize), dtype)[0])
            return value if 0 < value <= 65536 else 0

    def _column(self, name: str) -> Iterator[np.ndarray]:
        with self._member(name) as (file, _, dtype):
            for start in range(0, self._n, _BLOCK):
                want = min(_BLOCK, self._n - start) * dtype.itemsize
                data = file.read(want)
                if len(data) < want:
                    raise RecordingError(f"{self._path}: the array {name} is cut short; copy the file again")
                values = np.frombuffer(data, dtype)
                if name == "p" and dtype.kind == "i":
                    values = np.where(values == -1, 0, values)  # some tools write -1 for OFF
                yield values

    def _largest(self, name: str) -> int:
        return max((int(v.max()) + 1 for v in self._column(name)), default=0)

    def _load(self) -> Iterator[Events]:
        columns = zip(*(self._column(n) for n in self._columns))
        try:
            for block in columns:
                self._read += len(block[0])
                try:
                    yield Events.of(*block)
                except ValueError as e:
                    raise RecordingError(f"{self._path}: {e}") from None
        except (zipfile.BadZipFile, EOFError, OSError) as e:
            raise RecordingError(f"{self._path}: damaged archive ({e})") from None

    @property
    def position(self) -> float:
        return self._read / self._n if self._n else 1.0

    def close(self) -> None:
        self._zip.close()


class _Member:
    """One array of an archive: the open file behind its header, its shape and its type."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, name: str) -> None:
        self._path, self._zip, self._name = path, archive, name

    def __enter__(self) -> tuple[IO[bytes], tuple[int, ...], np.dtype]:
        try:
            self._file = self._zip.open(self._name + ".npy")
            version = npy.read_magic(self._file)
            read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, _, dtype = read(self._file)
        except (KeyError, ValueError, EOFError, OSError, RuntimeError, NotImplementedError, zipfile.BadZipFile) as e:
            raise RecordingError(f"{self._path}: the array {self._name} is damaged ({str(e)[:100]})") from None
        return self._file, shape, dtype

    def __exit__(self, *_: object) -> None:
        self._file.close()


def open_file(path: Path, options: OpenOptions) -> NpzRecording:
    """Open an archive. Raises RecordingError."""
    return NpzRecording(path, options)


class NpzWriter(Writer):
    """Collects each array in a temporary file beside the archive and joins them at the end, uncompressed."""

    def __init__(self, path: str | os.PathLike[str], width: int, height: int) -> None:
        super().__init__(path)
        self._size, self._n, self._colour = (width, height), 0, False
        self._columns = {n: tempfile.TemporaryFile(dir=self.path.parent) for n in _TYPES}

    def write(self, events: Events) -> None:
        if not len(events):
            return
        if self._n and self._colour != (events.c is not None):
            raise RecordingError(f"{self.path}: events with and without colour in one file")
        self._colour = events.c is not None
        self._n += len(events)
        for name in "txyp" + "c" * self._colour:
            self._columns[name].write(getattr(events, name).tobytes())

    def _finish(self) -> None:
        with zipfile.ZipFile(self.partial, "w", zipfile.ZIP_STORED) as archive:
            for name in "txyp" + "c" * self._colour:
                with archive.open(zipfile.ZipInfo(name + ".npy", _DATE), "w", force_zip64=True) as out:
                    descr = npy.dtype_to_descr(np.dtype(_TYPES[name]))
                    npy.write_array_header_1_0(out, {"descr": descr, "fortran_order": False, "shape": (self._n,)})
                    self._columns[name].seek(0)
                    shutil.copyfileobj(self._columns[name], out, 1 << 20)
            for name, value in zip(("width", "height"), self._size):
                with archive.open(zipfile.ZipInfo(name + ".npy", _DATE), "w") as out:
                    npy.write_array(out, np.array(value, np.int64))

    def discard(self) -> None:
        for file in self._columns.values():
            file.close()
        super().discard()


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> NpzWriter:
    """An archive writer. Raises RecordingError."""
    if encoding:
        raise RecordingError(f"{path}: an encoding ('{encoding}') is for .raw files; leave it out for .npz")
    return NpzWriter(path, width, height)
