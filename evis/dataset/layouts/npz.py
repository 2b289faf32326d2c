"""Plain NumPy archives: `<camera>/events.npz`, which `evis.open` reads too, and `<camera>/<kind>.npz`.

The arrays are not compressed, so that a part of one is read without the rest.
"""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.columns import ColumnsReader, ColumnsWriter, check_shape
from evis.files.whole_file import whole_file

_PART = ".part.npy"
_LOCAL_HEADER = 30
"""Bytes of a zip entry's header before its name (APPNOTE 4.3.7); the lengths of name and extra field are at 26, 28."""


class GrowingNpy:
    """Writes a .npy file whose first axis grows; the file is complete after `close`."""

    def __init__(self, path: Path, shape: tuple[int, ...], dtype: np.dtype) -> None:
        self.shape, self.dtype, self.count = shape, dtype, 0
        self._file: BinaryIO = path.open("w+b")
        self._header()
        self._begin = self._file.tell()

    def append(self, rows: np.ndarray) -> None:
        """Puts rows [n, *shape] at the end."""
        self._file.write(np.ascontiguousarray(rows, self.dtype).tobytes())
        self.count += len(rows)

    def close(self) -> None:
        """Writes how many rows there are into the header, for which numpy leaves room."""
        self._file.seek(0)
        self._header()
        assert self._file.tell() == self._begin
        self._file.close()

    def _header(self) -> None:
        about = {"descr": npy.dtype_to_descr(self.dtype), "fortran_order": False, "shape": (self.count, *self.shape)}
        npy.write_array_header_1_0(self._file, about)


def pack(path: Path, parts: dict[str, Path]) -> None:
    """Makes an archive, not compressed, of .npy files, array name -> path, and removes them."""
    with whole_file(path) as partial, zipfile.ZipFile(partial, "w") as archive:
        for name, part in parts.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry, part.open("rb") as file:
                shutil.copyfileobj(file, entry, 1 << 20)
    for part in parts.values():
        part.unlink()


class NpzWriter(ColumnsWriter):
    """Writes an archive per camera and kind of label; each array grows in a file of its own until the end."""

    LAYOUT = "npz"

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._files: dict[tuple[str, str], GrowingNpy] = {}

    def _append(self, camera: str, column: str, rows: np.ndarray) -> None:
        file = self._files.get((camera, column))
        if file is None:
            path = self._path(camera, column)
            path.parent.mkdir(parents=True, exist_ok=True)
            file = self._files[camera, column] = GrowingNpy(path, rows.shape[1:], rows.dtype)
        check_shape(camera, column, rows, file.shape, file.dtype)
        file.append(rows)

    def _path(self, camera: str, column: str) -> Path:
        return self.directory / camera / (column + _PART)

    def _finish(self) -> None:
        super()._finish()
        for file in self._files.values():
            file.close()
        for camera, kind in dict.fromkeys((camera, column.partition("/")[0]) for camera, column in self._files):
            folder = self.directory / camera / kind
            columns = [column for c, column in self._files if c == camera and column.startswith(f"{kind}/")]
            pack(folder.with_suffix(".npz"), {c.partition("/")[2]: self._path(camera, c) for c in columns})
            folder.rmdir()


class NpzReader(ColumnsReader):
    """Reads parts of the arrays where they lie in the archives."""

    def _columns(self, camera: str) -> tuple[str, ...]:
        found = []
        for path in sorted((self.directory / camera).glob("*.npz")):
            with _opened(path) as archive:
                found += [f"{path.stem}/{name.removesuffix('.npy')}" for name in archive.namelist()]
        return tuple(found)

    def _column(self, camera: str, column: str) -> Any:
        kind, _, name = column.partition("/")
        return mapped(self.directory / camera / f"{kind}.npz", name)


def _opened(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except (OSError, zipfile.BadZipFile) as error:
        raise LayoutError(f"{path} cannot be read ({error}); make the sequence anew") from None


def mapped(path: Path, name: str) -> np.ndarray:
    """Maps an array of an archive that is not compressed into memory. Raises LayoutError."""
    with _opened(path) as archive:
        try:
            info = archive.getinfo(f"{name}.npy")
        except KeyError:
            raise LayoutError(f"{path} has no array {name}; make the sequence anew") from None
    if info.compress_type != zipfile.ZIP_STORED:
        raise LayoutError(f"{path} is compressed; np.load reads it, and not in parts")
    with path.open("rb") as file:
        file.seek(info.header_offset)
        head = file.read(_LOCAL_HEADER)
        file.seek(int.from_bytes(head[26:28], "little") + int.from_bytes(head[28:30], "little"), 1)
        npy.read_magic(file)
        shape, fortran, dtype = npy.read_array_header_1_0(file)
        offset = file.tell()
    if 0 in shape:
        return np.empty(shape, dtype)
    return np.memmap(path, dtype, "r", offset, shape, "F" if fortran else "C")
