"""Writes a .npy file whose first axis grows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy


class GrowingNpy:
    """Writes a .npy file whose first axis grows; the file is complete after `close`."""

    def __init__(self, path: Path, shape: tuple[int, ...], dtype: np.dtype) -> None:
        self.shape, self.dtype, self.count = shape, dtype, 0
        self._path = path
        self._file: BinaryIO = path.open("w+b")
        self._header()
        self._begin = self._file.tell()

    def append(self, rows: np.ndarray) -> None:
        """Puts rows [n, *shape] at the end."""
        with self._named():
            self._file.write(np.ascontiguousarray(rows, self.dtype).tobytes())
        self.count += len(rows)

    def close(self) -> None:
        """Writes how many rows there are into the header, for which numpy leaves room."""
        with self._named():
            self._file.seek(0)
            self._header()
            assert self._file.tell() == self._begin
            self._file.close()

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Names the file where the disk refuses."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from None

    def _header(self) -> None:
        about = {"descr": npy.dtype_to_descr(self.dtype), "fortran_order": False, "shape": (self.count, *self.shape)}
        npy.write_array_header_1_0(self._file, about)
