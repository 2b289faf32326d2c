"""Reads a NumPy array of events, one a row: records with named fields, or four columns, as `.npy` or alone in an
`.npz`.

Four columns are told apart by what is in them: polarity is -1, 0 or 1, and the time goes up. Whole times are us (ns
where us would be thousands of years), others s.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from evis.events.arrays import Events
from evis.events.files.reading.bisection import place_before
from evis.events.files.reading.block_recording import BlockRecording, take_size
from evis.events.recording import OpenOptions, RecordingError, RecordingInfo
from evis.files.damage import error_text

NAME = "NumPy .npy with an event a row"

MAGIC = b"\x93NUMPY"
NAMES = {
    "t": ("t", "ts", "time", "times", "timestamp", "timestamps", "t_us", "t_ns"),
    "x": ("x", "xs"),
    "y": ("y", "ys"),
    "p": ("p", "ps", "pol", "polarity", "polarities", "on"),
}
"""Names of the columns in the fields of records and in the arrays of archives."""
_ORDERS = ("txyp", "xypt", "xytp")
_BLOCK = 1 << 18
LOOK = 4096
"""First times by which their unit is told."""
NS_FROM = 10**17
"""Whole times from here on can be no us: 3000 years."""
_LONGEST_HEADER = 10_000
"""Bytes; NumPy itself takes no longer one."""


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins with the signature of NumPy."""
    return head.startswith(MAGIC)


class NpyRecording(BlockRecording):
    """Reads an array of shape [n] with fields, or [n, 4]. Only the current block is in memory."""

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._path, self._done = path, 0
        self._file = path.open("rb")
        try:
            self._open(options)
        except BaseException:
            self._file.close()
            raise
        super().__init__()

    def _open(self, options: OpenOptions) -> None:
        path = self._path
        try:
            shape, self._fortran, dtype = read_header(self._file)
        except ValueError as error:
            raise RecordingError(f"{path}: the array's header is damaged ({str(error)[:80]})") from None
        self._start = self._file.tell()
        fields = dict.fromkeys(dtype.names or (), "")
        columns = {c: next((n for n in names if n in fields), "") for c, names in NAMES.items()}
        table = dtype.names is None and len(shape) == 2 and shape[1] == 4 and dtype.kind in "iuf"
        if dtype.hasobject or not dtype.itemsize or not (table or (len(shape) == 1 and all(columns.values()))):
            raise RecordingError(
                f"{path}: an array of {dtype if dtype.names is None else dtype.names} {list(shape)}; known are an "
                "event a row as records with fields t, x, y, p, or as four columns"
            )
        self._n = self._total = int(shape[0])
        self._dtype = np.dtype((dtype, (4,))) if table else dtype
        there = max(os.fstat(self._file.fileno()).st_size - self._start, 0) // self._dtype.itemsize
        kind = "npz" if options.name.endswith(".npz") else "npy"
        self.info = RecordingInfo(str(path), kind, "", 0, 0, "", path.stat().st_size)
        if there < self._n:
            self.info.truncated = True
            self.info.warn(f"cut: {there} of {self._n} events are there")
            if self._fortran and table:
                raise RecordingError(f"{path}: cut, and its columns follow one another, so that no event is whole")
            self._n = there
        sample = self._rows(0, min(self._n, LOOK))
        self._columns = columns if not table else {name: str(i) for i, name in enumerate(self._order(sample))}
        self._find_unit(sample)
        if not take_size(self.info, options):
            self._size_from_events()

    def _rows(self, first: int, count: int) -> np.ndarray:
        if self._fortran and self._dtype.subdtype is not None:
            base, size = self._dtype.base, self._dtype.base.itemsize
            parts = [self._pread(count * size, self._start + (c * self._n + first) * size) for c in range(4)]
            return np.stack([np.frombuffer(part, base) for part in parts], axis=1)
        data = self._pread(count * self._dtype.itemsize, self._start + first * self._dtype.itemsize)
        rows: np.ndarray = np.frombuffer(data, self._dtype, count)
        return rows

    def _pread(self, size: int, at: int) -> bytes:
        data = os.pread(self._file.fileno(), size, at)
        if len(data) < size:
            raise RecordingError(f"{self._path}: the file became shorter while it was read")
        return data

    def _order(self, rows: np.ndarray) -> str:
        """Finds the order of the four columns, as letters of `txyp`. Raises RecordingError."""
        fits = []
        with np.errstate(invalid="ignore"):
            for order in _ORDERS:
                t, x, y, p = (rows[:, order.index(name)].astype(np.float64) for name in "txyp")
                inside = all(((v >= 0) & (v < 65536) & (v == np.floor(v))).all() for v in (x, y))
                if inside and np.isin(p, (-1, 0, 1)).all() and (np.diff(t) >= 0).all():
                    fits.append((float(t.max(initial=0)), order))
        if not fits:
            raise RecordingError(f"{self._path}: none of its four columns can be the polarity or a time that goes up")
        return max(fits)[1]

    def _column(self, rows: np.ndarray, name: str) -> np.ndarray:
        column: np.ndarray = rows[self._columns[name]] if rows.dtype.names else rows[:, int(self._columns[name])]
        return column

    def _find_unit(self, rows: np.ndarray) -> None:
        t, name = self._column(rows, "t"), self._columns["t"]
        whole = t.dtype.kind in "iu" or (t == np.floor(t)).all()
        ns = name == "t_ns" or (whole and len(t) and float(np.abs(t.astype(np.float64)).max()) >= NS_FROM)
        self._unit = 1_000_000_000 if not whole else 1 if ns else 1000
        self.info.encoding = f"t in {({1: 'ns', 1000: 'us', 10**9: 's'})[self._unit]}"
        if name not in ("t_ns", "t_us"):
            self.info.warn(f"the times are taken as {self.info.encoding.removeprefix('t in ')}")

    def _load(self) -> Iterator[Events]:
        return self._load_at(0)

    def _load_at(self, at: int) -> Iterator[Events]:
        while at < self._n:
            rows = self._rows(at, min(_BLOCK, self._n - at))
            at += len(rows)
            self._done = at
            x, y, p = (self._whole(self._column(rows, name), name) for name in "xyp")
            try:
                yield Events.of(self._times(self._column(rows, "t")), x, y, np.maximum(p, 0))
            except ValueError as error:
                raise RecordingError(f"{self._path}: {error}") from None

    def _whole(self, values: np.ndarray, name: str) -> np.ndarray:
        if values.dtype.kind == "f" and not (np.isfinite(values).all() and (values == np.floor(values)).all()):
            raise RecordingError(f"{self._path}: {name} has values that are no whole numbers")
        return values.astype(np.int64)

    def _times(self, t: np.ndarray) -> np.ndarray:
        if self._unit < 10**9 and t.dtype.kind in "iu":
            return t.astype(np.int64) * self._unit
        seconds = t.astype(np.float64) if self._unit == 10**9 else t.astype(np.float64) / 1e6
        if not np.isfinite(seconds).all():
            raise RecordingError(f"{self._path}: a time is not finite")
        if not (np.abs(seconds) < 9e9).all():
            raise RecordingError(f"{self._path}: times that are no {self.info.encoding.removeprefix('t in ')}")
        return t.astype(np.int64) * self._unit if self._unit < 10**9 else seconds_in_ns(seconds)

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        """Yields blocks from a row found by bisection; times are taken to go up."""

        def is_earlier(row: int) -> bool:
            return int(self._times(self._column(self._rows(row, 1), "t"))[0]) < t_ns

        return self._load_at(place_before(0, self._n, _BLOCK, is_earlier))

    @property
    def position(self) -> float:
        return self._done / self._n if self._n else 1.0

    def close(self) -> None:
        self._file.close()


def read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Reads shape, whether column by column, and type of the array that begins here. Raises ValueError.

    A header whose length says more than any has is not read: packed, it would cost little to say gigabytes.
    """
    start = file.read(len(MAGIC) + 2)
    if not start.startswith(MAGIC) or len(start) < len(MAGIC) + 2:
        raise ValueError("it does not begin as an array does")
    field = file.read(2 if start[-2] == 1 else 4)
    length = int.from_bytes(field, "little")
    if length > _LONGEST_HEADER:
        raise ValueError(f"its header claims {length} bytes, the most is {_LONGEST_HEADER}")
    read = npy.read_array_header_1_0 if start[-2] == 1 else npy.read_array_header_2_0
    try:
        shape, fortran, dtype = read(io.BytesIO(field + file.read(length)))
    except Exception as error:  # the reader of headers hands on what Python's parser raises
        raise ValueError(error_text(error)) from None
    if any(side < 0 for side in shape):
        raise ValueError(f"its shape is {list(shape)}")
    return shape, fortran, dtype


def is_whole(values: np.ndarray) -> bool:
    """Tells whether all of them are whole numbers, and there are at least two different ones."""
    return bool((values == np.floor(values)).all()) and bool((values != values[:1]).any())


def seconds_in_ns(seconds: np.ndarray) -> np.ndarray:
    """Converts times [s] to int64 [ns]. Raises ValueError where they are no times."""
    values = seconds.astype(np.float64)
    if not (np.isfinite(values).all() and (np.abs(values) < 9e9).all()):
        raise ValueError("values that are no times in s")
    # whole seconds apart: their product with 1e9 would be rounded to 256 ns
    whole = np.floor(values)
    return whole.astype(np.int64) * 1_000_000_000 + np.rint((values - whole) * 1e9).astype(np.int64)


def open_file(path: Path, options: OpenOptions) -> NpyRecording:
    """Opens an array. Raises RecordingError."""
    return NpyRecording(path, options)
