"""Opens HDF5 files to write, whose disk may become full without harm to the process."""

from __future__ import annotations

import io
import os
from typing import Any

import h5py


class _Output(io.FileIO):
    """Keeps the first fault of the disk and accepts all that comes behind it.

    HDF5 cannot be told of it: it would write what it holds again when its objects go, and end the process.
    """

    fault: OSError | None = None

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            while left and self.fault is None:
                left = left[super().write(left) :]
        except OSError as error:
            self.fault = error
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size) if self.fault is None else size or 0
        except OSError as error:
            self.fault = error
            return size or 0


class NewFile(h5py.File):
    """Holds a new HDF5 file, in place of an older one. options: of h5py.File.

    What the disk refuses is told by `check` and by `close`, with the disk's own errno.
    """

    def __init__(self, path: str | os.PathLike[str], **options: Any) -> None:
        self._output = _Output(path, "w+")
        super().__init__(self._output, "w", **options)

    def check(self) -> None:
        """Raises OSError where the disk has refused something so far."""
        if self._output.fault is not None:
            raise self._output.fault

    def close(self) -> None:
        """Writes what is left. Raises OSError where anything of the file was refused."""
        super().close()
        self._output.close()
        self.check()
