"""Writes and reads plain NumPy archives: `<camera>/events.npz`, which `evis.open` reads too, and `<camera>/<kind>.npz`.

The arrays are not compressed, so that a part of one is read without the rest. What an archive says of an array is
checked before any of it is used: an array of Python's objects would be addresses in memory, taken from the file.
"""

from __future__ import annotations

import io
import math
import shutil
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.reader import ANEW
from evis.events.files.numpy_files.npy import read_header
from evis.files.allowance import Allowance
from evis.files.regular import check_file
from evis.files.whole_file import whole_file

_LOCAL_HEADER = 30
"""Bytes of a zip entry's header before its name (APPNOTE 4.3.7); the lengths of name and extra field are at 26, 28."""


def pack(path: Path, parts: dict[str, Path]) -> None:
    """Makes an archive, not compressed, of .npy files, array name -> path, and removes them."""
    with whole_file(path) as partial, zipfile.ZipFile(partial, "w") as archive:
        for name, part in parts.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry, part.open("rb") as file:
                shutil.copyfileobj(file, entry, 1 << 20)
    for part in parts.values():
        part.unlink()


def opened(path: Path) -> zipfile.ZipFile:
    """Opens an archive of arrays. Raises LayoutError for one that is damaged or not there."""
    check_file(path)
    try:
        return zipfile.ZipFile(path)
    except (OSError, zipfile.BadZipFile) as error:
        raise LayoutError(f"{path} cannot be read ({error}); {ANEW}") from None


def mapped(path: Path, name: str) -> np.ndarray:
    """Maps an array of an archive that is not compressed into memory. Raises LayoutError."""
    with opened(path) as archive:
        try:
            info = archive.getinfo(f"{name}.npy")
        except KeyError:
            raise LayoutError(f"{path} has no array {name}; {ANEW}") from None
    if info.compress_type != zipfile.ZIP_STORED:
        raise LayoutError(f"{path} is compressed; np.load reads it, and not in parts")
    with path.open("rb") as file:
        file.seek(info.header_offset)
        head = file.read(_LOCAL_HEADER)
        file.seek(int.from_bytes(head[26:28], "little") + int.from_bytes(head[28:30], "little"), 1)
        shape, fortran, dtype = _header(file, f"{path}: {name}")
        offset = file.tell()
    if 0 in shape:
        return np.empty(shape, dtype)
    return np.memmap(path, dtype, "r", offset, shape, "F" if fortran else "C")


def unpacked(content: bytes, what: str) -> dict[str, np.ndarray]:
    """Reads all arrays of a compressed archive, by name, no more of them than its size allows.

    what: names it in errors. Raises LayoutError, AllowanceError, and what `zipfile` raises for a damaged one.
    """
    found: dict[str, np.ndarray] = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        Allowance(len(content)).check(sum(member.file_size for member in archive.infolist()))
        for member in archive.infolist():
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as file:
                shape, fortran, dtype = _header(file, f"{what}: {name}")
                data = file.read()  # at most what was checked
            if len(data) != math.prod(shape) * dtype.itemsize:
                raise LayoutError(f"{what}: {name} has {len(data)} bytes for {list(shape)} of {dtype}; {ANEW}")
            found[name] = np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")
    return found


def _header(file: IO[bytes], what: str) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether column by column, and type of an array of numbers. Raises LayoutError."""
    try:
        shape, fortran, dtype = read_header(file)
    except ValueError as error:
        raise LayoutError(f"{what} cannot be read ({error}); {ANEW}") from None
    if dtype.kind not in "biuf":
        raise LayoutError(f"{what} is an array of {dtype}, and must be one of numbers; {ANEW}")
    return shape, fortran, dtype
