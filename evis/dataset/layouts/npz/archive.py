"""Writes and reads plain NumPy archives: `<camera>/events.npz`, which `evis.open` reads too, and `<camera>/<kind>.npz`.

The arrays are not compressed, so that a part of one is read without the rest.
"""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.reader import ANEW
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
        npy.read_magic(file)
        shape, fortran, dtype = npy.read_array_header_1_0(file)
        offset = file.tell()
    if 0 in shape:
        return np.empty(shape, dtype)
    return np.memmap(path, dtype, "r", offset, shape, "F" if fortran else "C")
