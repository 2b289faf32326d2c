"""Reads a sequence of Zarr arrays."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.columns import ColumnsReader
from evis.dataset.layouts.reader import ANEW
from evis.dataset.layouts.zarr.package import FOLDER, zarr
from evis.files.allowance import Allowance, AllowanceError
from evis.files.damage import error_text
from evis.files.json_text import parsed
from evis.files.magic import ZSTD

_NUMBERS = re.compile(r"bool|u?int(8|16|32|64)|float(16|32|64)")
_CODECS = ("bytes", "zstd")
_HEAD = 18
"""Longest header of a frame of Zstandard [bytes]."""


class Column:
    """Reads slices of an array. Raises LayoutError where chunks are missing, which Zarr takes for zeros, or damaged."""

    def __init__(self, path: Path) -> None:
        package = zarr()
        self._path = path
        if not (path / "zarr.json").is_file():
            raise LayoutError(f"{path} is not there; {ANEW}")
        _check_codecs(path)
        self._array = package.open_array(str(path), mode="r", zarr_format=3)
        self.shape = self._array.shape
        self._room = math.prod(self._array.chunks) * self._array.dtype.itemsize

    def __getitem__(self, part: Any) -> np.ndarray:
        self._check(part)
        try:
            return np.asarray(self._array[part])
        except (RuntimeError, ValueError, OSError) as error:  # its codecs raise the first
            raise LayoutError(f"{self._path} cannot be read ({error_text(error, 150)}); {ANEW}") from error

    def _check(self, part: Any) -> None:
        """Looks whether the chunks along the first axis are there."""
        rows = range(self.shape[0])[part] if isinstance(part, slice) else range(int(part), int(part) + 1)
        size = self._array.chunks[0]
        for k in range(rows.start // size, (rows.stop - 1) // size + 1) if len(rows) else ():
            name = "/".join(["c", str(k), *["0"] * (len(self.shape) - 1)])
            if not (self._path / name).is_file():
                raise LayoutError(f"{self._path} lacks a chunk, {name}; {ANEW}")
            self._check_chunk(self._path / name)

    def _check_chunk(self, path: Path) -> None:
        """Looks whether a chunk unpacks to what a chunk has, and that is not too much for its size: Zarr would see."""
        size = path.stat().st_size
        try:
            Allowance(size).check(self._room)
        except AllowanceError as error:
            raise LayoutError(f"{path}: {error}") from None
        with path.open("rb") as file:
            head = file.read(_HEAD)
        if head.startswith(ZSTD) and not _unpacked_size(head) <= self._room:
            raise LayoutError(f"{path} unpacks to more than the {self._room} bytes of a chunk; {ANEW}")


def _check_codecs(path: Path) -> None:
    """Raises LayoutError for an array of anything but numbers, or packed as no writer of EVIS does."""
    try:
        told = parsed((path / "zarr.json").read_text())
        kind, codecs = told["data_type"], [codec["name"] for codec in told["codecs"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LayoutError(f"{path}/zarr.json cannot be read ({error_text(error, 150)}); {ANEW}") from None
    if not isinstance(kind, str) or not _NUMBERS.fullmatch(kind):
        raise LayoutError(f"{path} is an array of {kind!s:.40}, and must be one of numbers; {ANEW}")
    if other := [name for name in codecs if name not in _CODECS]:
        raise LayoutError(f"{path} is packed by {other[0]!s:.40}, and must be by {', '.join(_CODECS)}; {ANEW}")


def _unpacked_size(head: bytes) -> float:
    """What a frame of Zstandard says that it unpacks to [bytes]; without end where it does not say."""
    import zstandard

    try:
        size = zstandard.frame_content_size(head)
    except zstandard.ZstdError:
        return 0  # damaged, as reading it finds out
    return size if size >= 0 else math.inf


class ZarrReader(ColumnsReader):
    """Reads the chunks that are asked for."""

    LAYOUT = "zarr"

    def _column(self, camera: str, column: str) -> Column:
        return Column(self.directory / FOLDER / camera / column)

    def _columns(self, camera: str) -> tuple[str, ...]:
        root = self.directory / FOLDER / camera
        return tuple(sorted(p.parent.relative_to(root).as_posix() for p in root.glob("*/*/zarr.json")))
