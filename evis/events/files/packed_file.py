"""Reads files compressed as a whole (Zstandard, as rosbag2 does; gzip, bzip2, xz), and a recording in a zip archive.
Both are unpacked into a temporary file without a name."""

from __future__ import annotations

import bz2
import lzma
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from evis.events.arrays import Events
from evis.events.files.numpy_files.npy import MAGIC as NPY
from evis.events.files.numpy_files.npy import NAMES
from evis.events.files.reading.unpacked_file import UnpackedFile
from evis.events.files.reading.zip_archive import RECORDINGS, files_in, open_archive
from evis.events.recording import HEAD, OpenOptions, Recording, RecordingError, open_as
from evis.files.allowance import Allowance
from evis.files.magic import ZIP, ZSTD
from evis.files.zip_faults import ZIP_FAULTS

NAME = "any of these in Zstandard, gzip, bzip2, xz or zip"


class _Gunzip:
    """Unpacks gzip with the interface of the other decompressors."""

    def __init__(self) -> None:
        self._inner, self._left = zlib.decompressobj(16 + zlib.MAX_WBITS), b""

    def decompress(self, data: bytes, most: int) -> bytes:
        part = self._inner.decompress(self._left + data, most)
        self._left = self._inner.unconsumed_tail
        return part

    @property
    def needs_input(self) -> bool:
        return not self._left and not self.eof

    @property
    def eof(self) -> bool:
        return self._inner.eof

    @property
    def unused_data(self) -> bytes:
        return self._inner.unused_data


_UNPACKERS: dict[bytes, Callable[[], Any]] = {
    b"\x1f\x8b": _Gunzip,
    b"BZh": bz2.BZ2Decompressor,
    b"\xfd7zXZ\0": lzma.LZMADecompressor,
}
_SUFFIXES = (".zst", ".zstd", ".gz", ".bz2", ".xz", ".zip", ".npz")
_MOST_LAYERS = 3
_ERRORS = (*ZIP_FAULTS, lzma.LZMAError)
_STEP = 1 << 20
_open = threading.local()
"""Number of packed files, one around the other, that are being opened, and what all of them together may unpack."""


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins as a compressed one, or is an archive with a recording in it (but those of text, and
    of arrays by the names of events, are read as they are).
    """
    return head.startswith((ZSTD, *_UNPACKERS)) or (head.startswith(ZIP) and bool(_members(path)))


def _members(path: Path) -> list[str]:
    """Lists the files of an archive that can be recordings: tables of NumPy, or others with a name that one
    would have."""
    try:
        archive = open_archive(path)
        names = files_in(archive)
        arrays = [n for n in names if n.endswith(".npy")]
        known = {name for column in NAMES.values() for name in column}
        if any(n.removesuffix(".npy") in known for n in arrays):
            return []
        tables = [n for n in arrays if _is_table(archive.open(n))]
        archive.close()
    except (*_ERRORS, KeyError, ValueError):
        return []
    found = tables if arrays else [n for n in names if n.lower().endswith(RECORDINGS)]
    named = [n for n in found if "event" in n.rpartition("/")[2].lower()]
    return named if len(named) == 1 else found


def _is_table(file: IO[bytes]) -> bool:
    """Tells whether a file is an array with a row per event."""
    with file:
        head = file.read(HEAD)
    return head.startswith(NPY) and (b"('t" in head or b"('x'" in head or b", 4)" in head)


class PackedRecording(Recording):
    """Reads a compressed file from its unpacked copy, which `close` removes."""

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path = path
        layers: int = getattr(_open, "layers", 0)
        if layers >= _MOST_LAYERS:
            raise RecordingError(f"{path}: packed more than {_MOST_LAYERS} times, one in another")
        size = path.stat().st_size
        allowance: Allowance = _open.allowance if layers else Allowance(size)
        self._copy = UnpackedFile(path, allowance)
        _open.layers, _open.allowance = layers + 1, allowance
        try:
            inner, whole = self._unpack(path, options)
            if not self._copy.size:
                raise RecordingError(f"{path}: its compressed data are damaged or cut before anything can be unpacked")
            with self._named():
                self._inner = open_as(self._copy.path, inner)
        except BaseException:
            self._copy.close()
            raise
        finally:
            _open.layers = layers
        about = self._inner.info
        self.info = replace(about, path=str(path), size_bytes=size, warnings=about.warnings)
        if not whole:
            self.info.truncated = True
            self.info.warn("its compressed data end early")

    def _unpack(self, path: Path, options: OpenOptions) -> tuple[OpenOptions, bool]:
        """Fills the copy; returns how it is to be opened, and whether all of it could be unpacked."""
        stem, dot, suffix = options.name.rpartition(".")
        name = stem if dot + suffix.lower() in _SUFFIXES else options.name
        with path.open("rb") as file:
            head = file.read(8)
        if head.startswith(ZIP):
            names, topic = _members(path), options.topic
            if topic in names:
                names, topic = [topic], ""
            if len(names) > 1:
                raise RecordingError(f"{path}: an archive of {len(names)} recordings; name one of {', '.join(names)}")
            whole = _unpack_into(self._copy, _member_parts(path, names[0]))
            return replace(options, topic=topic, name=names[0].rpartition("/")[2]), whole
        if head.startswith(ZSTD):
            return replace(options, name=name), _unpack_zstd(path, self._copy)
        make = next(made for magic, made in _UNPACKERS.items() if head.startswith(magic))
        return replace(options, name=name), _unpack_into(self._copy, _unpacked_parts(path, make))

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Replaces the copy's name in errors by that of the packed file."""
        try:
            yield
        except RecordingError as error:
            raise RecordingError(str(error).replace(str(self._copy.path), str(self._path))) from error.__cause__

    def blocks(self) -> Iterator[Events]:
        blocks = self._inner.blocks()
        while True:
            with self._named():
                events = next(blocks, None)
            self._tell()
            if events is None:
                return
            yield events

    def _tell(self) -> None:
        self.info.truncated |= self._inner.info.truncated

    def read_until(self, t_ns: int) -> Events:
        with self._named():
            events = self._inner.read_until(t_ns)
        self._tell()
        return events

    def read_aside(self, t_ns: int) -> Events:
        with self._named():
            events = self._inner.read_aside(t_ns)
        self._tell()
        return events

    def seek(self, t_ns: int) -> None:
        with self._named():
            self._inner.seek(t_ns)

    @property
    def next_t_ns(self) -> int | None:
        with self._named():
            return self._inner.next_t_ns

    @property
    def raw(self) -> np.ndarray | None:
        return self._inner.raw

    def counters(self) -> dict[str, int]:
        return self._inner.counters()

    @property
    def position(self) -> float:
        return self._inner.position

    def close(self) -> None:
        self._inner.close()
        self._copy.close()


def _member_parts(path: Path, name: str) -> Iterator[bytes]:
    """Yields a file of an archive in pieces."""
    with open_archive(path).open(name) as file:
        while part := file.read(_STEP):
            yield part


def _unpacked_parts(path: Path, make: Callable[[], Any]) -> Iterator[bytes]:
    """Yields what a file unpacks to, in pieces; it may be several compressed files in a row. Raises EOFError at
    a cut."""
    with path.open("rb") as file:
        data = file.read(_STEP)
        while data:
            unpacker = make()
            while not unpacker.eof:
                if unpacker.needs_input and not data:
                    data = file.read(_STEP)
                    if not data:
                        raise EOFError
                part, data = unpacker.decompress(data, _STEP), b""
                yield part
            data = unpacker.unused_data.lstrip(b"\0") or file.read(_STEP)


def _unpack_into(copy: UnpackedFile, parts: Iterator[bytes]) -> bool:
    """Unpacks into a copy as far as the file goes; False where it ends early or is damaged."""
    while True:
        try:
            part = next(parts, None)
        except _ERRORS:
            return False
        if part is None:
            return True
        copy.put(part)


def _unpack_zstd(path: Path, copy: UnpackedFile) -> bool:
    import zstandard

    unpacker = zstandard.ZstdDecompressor(max_window_size=1 << 27)
    try:
        with path.open("rb") as file:
            known = zstandard.frame_content_size(file.read(64))
            file.seek(0)
            for part in unpacker.read_to_iter(file, write_size=_STEP):
                copy.put(part)
    except zstandard.ZstdError:
        return False
    return known < 0 or known == copy.size


def open_file(path: Path, options: OpenOptions) -> PackedRecording:
    """Opens what is in a compressed file. Raises RecordingError."""
    return PackedRecording(path, options)
