"""Reads and writes events as a NumPy archive: arrays t (int64 ns), x, y (uint16), p (uint8), and optionally c, width
and height.

Whole times under another name than `t` (ns) are us; times with a fraction are s. Archives of any size are
read and written in blocks; nothing is ever unpickled.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from evis.events.arrays import Events
from evis.events.files.file_writer import refuse_encoding
from evis.events.files.numpy_files.npy import NAMES, read_header, seconds_in_ns
from evis.events.files.reading.block_recording import BlockRecording
from evis.events.files.reading.zip_archive import Archive, CutArchive, open_archive, salvaged
from evis.events.recording import OpenOptions, RecordingError, RecordingInfo, Writer
from evis.files.allowance import Allowance
from evis.files.damage import error_text
from evis.files.magic import EMPTY_ZIP, ZIP
from evis.files.zip_faults import UNREADABLE, ZIP_FAULTS

NAME = "NumPy .npz of t, x, y, p"

_BLOCK, _LOOK = 1 << 20, 4096
_TYPES: dict[str, Any] = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8, "c": np.uint8}
_BROKEN = (KeyError, ValueError, *ZIP_FAULTS)
# the same archive from the same events: no date in it
_DATE = (1980, 1, 1, 0, 0, 0)


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file is a zip archive."""
    return head.startswith((ZIP, EMPTY_ZIP))


class NpzRecording(BlockRecording):
    """Reads an archive of event arrays. Only the current block is in memory, also where the archive is compressed.

    Of a damaged archive, the events of which each array has its part before the damage shows.
    """

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path, self._read = path, 0
        try:
            self._zip: Archive = open_archive(path)
        except UNREADABLE as e:
            raise RecordingError(f"{path}: damaged or truncated .npz archive ({e})") from None
        try:
            self._check(options)
        except BaseException:
            self._zip.close()
            raise
        super().__init__()

    def _check(self, options: OpenOptions) -> None:
        self.info = RecordingInfo(str(self._path), "npz", "", 0, 0, "file", self._path.stat().st_size)
        path, names, self._names = self._path, {n.removesuffix(".npy") for n in self._zip.namelist()}, {}
        if isinstance(self._zip, CutArchive):
            names = {n for n in names if self._has_header(n)}
        self._names = {c: next((n for n in NAMES.get(c, (c,)) if n in names), "") for c in "txypc"}
        missing = [c for c in "txyp" if not self._names[c]]
        if missing and isinstance(self._zip, CutArchive):
            raise RecordingError(f"{path}: cut before the array {missing[0]}, so that no event is whole")
        if missing:
            hint = "; it holds frames: use `evis events simulate`" if "luminance" in names else ""
            hint = hint or f"; it has {', '.join(sorted(names)[:8]) or 'none'}"
            raise RecordingError(f"{path}: no array {', '.join(missing)} in the archive{hint}")
        self._columns = [c for c in "txypc" if self._names[c]]
        lengths, rows, self._unit = {}, {}, "ns"
        for name in self._columns:
            with self._member(name) as (file, shape, dtype):
                real = dtype.kind == "f" and name == "t" and self._names["t"] not in ("t_us", "t_ns")
                number = dtype.kind in "iu" or real or (dtype.kind == "f" and name in "xyp")
                if shape[1:] not in ((), (1,)) or not shape or not (number or (name == "p" and dtype.kind == "b")):
                    unit = " of ns, or of s with a fraction" if name == "t" else ""
                    raise RecordingError(
                        f"{path}: {name} is {dtype} {list(shape)}, must be a flat array of whole numbers{unit}"
                    )
                lengths[name] = shape[0]
                rows[name] = self._values_before_cut(file, shape[0], dtype)
                if name == "t":
                    self._unit = "ns" if not real and self._names["t"] in ("t", "t_ns") else "us"
                    if real:
                        data = self._read_bytes(file, name, min(_LOOK, rows[name]) * dtype.itemsize)
                        first = np.frombuffer(data[: len(data) // dtype.itemsize * dtype.itemsize], dtype)
                        self._unit = "us" if (first == np.floor(first)).all() else "s"
        if len(set(lengths.values())) != 1:
            raise RecordingError(f"{path}: arrays of different lengths: {lengths}")
        self._n = min(rows.values())
        info = self.info
        info.width, info.height = self._scalar("width", names), self._scalar("height", names)
        if options.size:
            (info.width, info.height), info.geometry_from = options.size, "option"
        if not (info.width and info.height):
            info.width, info.height, info.geometry_from = self._largest("x"), self._largest("y"), "events"
            info.warn(f"no width and height in the archive: {info.width}x{info.height} are the largest coordinates")
        if self._unit != "ns" or (self._names["t"] == "t" and info.geometry_from == "events"):
            info.warn(f"the times in {self._names['t']} are taken as {self._unit}")
        if isinstance(self._zip, CutArchive):
            info.truncated = True
            info.warn(f"cut: {self._n} of {lengths['t']} events have all of their parts before the cut")

    def _has_header(self, name: str) -> bool:
        """Tells whether the cut has left the header of an array; of a single number, all of it."""
        with contextlib.suppress(RecordingError), self._member(name) as (file, shape, dtype):
            return bool(shape) or len(file.read(dtype.itemsize)) == dtype.itemsize
        return False

    def _values_before_cut(self, file: IO[bytes], n: int, dtype: np.dtype) -> int:
        """Counts how many of n values a cut archive has."""
        if not isinstance(self._zip, CutArchive):
            return n
        begin, at, allowance = file.tell(), 0, Allowance(self.info.size_bytes)
        while data := file.read(_BLOCK):
            at += len(data)
            allowance.take(len(data))
        file.seek(begin)
        return min(n, at // dtype.itemsize)

    def _member(self, name: str) -> _OpenArray:
        return _OpenArray(self._path, self._zip, self._names.get(name, name), self.info)

    def _scalar(self, name: str, names: set[str]) -> int:
        if name not in names:
            return 0
        with self._member(name) as (file, shape, dtype):
            if shape != () or dtype.kind not in "iu":
                return 0
            data = self._read_bytes(file, name, dtype.itemsize)
            value = int(np.frombuffer(data, dtype)[0]) if len(data) == dtype.itemsize else 0
            return value if 0 < value <= 65535 else 0

    def _column(self, name: str, allowance: Allowance) -> Iterator[np.ndarray]:
        with self._member(name) as (file, _, dtype):
            for start in range(0, self._n, _BLOCK):
                want = min(_BLOCK, self._n - start) * dtype.itemsize
                data = self._read_bytes(file, name, want)
                allowance.take(len(data))
                rows = len(data) // dtype.itemsize
                if rows:
                    yield self._values(name, np.frombuffer(data, dtype, rows))
                if len(data) < want:
                    self.info.truncated = True
                    self.info.warn(f"damaged or cut: the array {name} ends at event {start + rows} of {self._n}")
                    return

    def _read_bytes(self, file: IO[bytes], name: str, size: int) -> bytes:
        """Reads the next bytes of an array, fewer where the archive is damaged."""
        begin = file.tell()
        try:
            return file.read(size)
        except ZIP_FAULTS as error:
            self.info.warn(f"damaged: the array {name} ({error_text(error, 80)})")
        if isinstance(self._zip, CutArchive):
            return b""
        try:
            with salvaged(self._path, self._zip.getinfo(self._names.get(name, name) + ".npy")) as rest:
                rest.seek(begin)
                return rest.read(size)
        except _BROKEN:
            return b""

    def _values(self, name: str, values: np.ndarray) -> np.ndarray:
        """Converts times to ns, and the -1 that some programs write for OFF to 0."""
        if name == "p" and values.dtype.kind in "if":
            if values.dtype.kind == "f" and not np.isin(values, (-1, 0, 1)).all():
                raise RecordingError(f"{self._path}: {self._names['p']} has other values than -1, 0 and 1")
            return np.where(values == -1, 0, values).astype(values.dtype if values.dtype.kind == "i" else np.uint8)
        if name in "xy" and values.dtype.kind == "f":
            if not ((values >= 0) & (values < 65536) & (values == np.floor(values))).all():
                raise RecordingError(f"{self._path}: {self._names[name]} has values that are no pixels")
            return values.astype(np.uint16)
        if name != "t" or self._unit == "ns":
            return values
        if not np.isfinite(values).all():
            raise RecordingError(f"{self._path}: {self._names['t']} holds a value that is not finite")
        most = 9e15 if self._unit == "us" else 9e9
        if not (np.abs(values.astype(np.float64)) < most).all():
            raise RecordingError(f"{self._path}: {self._names['t']} has times that are no {self._unit}")
        if self._unit == "us" and (values.dtype.kind != "f" or (values == np.floor(values)).all()):
            return values.astype(np.int64) * 1000
        if self._unit == "us":
            raise RecordingError(f"{self._path}: {self._names['t']} begins with whole us and goes on with fractions")
        return seconds_in_ns(values)

    def _largest(self, name: str) -> int:
        allowance = Allowance(self.info.size_bytes)
        return max((int(v.max()) + 1 for v in self._column(name, allowance)), default=0)

    def _load(self) -> Iterator[Events]:
        allowance = Allowance(self.info.size_bytes)
        for block in zip(*(self._column(n, allowance) for n in self._columns)):
            rows = min(map(len, block))
            self._read += rows
            try:
                yield Events.of(*(column[:rows] for column in block))
            except ValueError as e:
                raise RecordingError(f"{self._path}: {e}") from None

    @property
    def position(self) -> float:
        return self._read / self._n if self._n else 1.0

    def close(self) -> None:
        self._zip.close()


class _OpenArray:
    """Opens one array of an archive: the file behind its header, its shape and its type."""

    def __init__(self, path: Path, archive: Archive, name: str, info: RecordingInfo) -> None:
        self._path, self._zip, self._name, self._info = path, archive, name, info

    def __enter__(self) -> tuple[IO[bytes], tuple[int, ...], np.dtype]:
        name = self._name + ".npy"
        try:
            try:
                self._file = self._zip.open(name)
                shape, _, dtype = read_header(self._file)
            except ZIP_FAULTS as error:
                if isinstance(self._zip, CutArchive):
                    raise
                # a small array is checked as a whole with its first byte
                self._file = salvaged(self._path, self._zip.getinfo(name))
                shape, _, dtype = read_header(self._file)
                self._info.warn(f"damaged: the array {self._name} ({error_text(error, 80)})")
        except _BROKEN as e:
            raise RecordingError(f"{self._path}: the array {self._name} is damaged ({str(e)[:100]})") from None
        return self._file, shape, dtype

    def __exit__(self, *_: object) -> None:
        self._file.close()


def open_file(path: Path, options: OpenOptions) -> NpzRecording:
    """Opens an archive. Raises RecordingError."""
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
    """Returns an archive writer. Raises RecordingError."""
    refuse_encoding(path, encoding, ".npz")
    return NpzWriter(path, width, height)
