"""Reads a sequence of Zarr arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.columns import ColumnsReader
from evis.dataset.layouts.reader import ANEW
from evis.dataset.layouts.zarr.package import FOLDER, zarr
from evis.files.damage import error_text


class Column:
    """Reads slices of an array. Raises LayoutError where chunks are missing, which Zarr takes for zeros, or damaged."""

    def __init__(self, path: Path) -> None:
        package = zarr()
        self._path = path
        if not (path / "zarr.json").is_file():
            raise LayoutError(f"{path} is not there; {ANEW}")
        self._array = package.open_array(str(path), mode="r")
        self.shape = self._array.shape

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


class ZarrReader(ColumnsReader):
    """Reads the chunks that are asked for."""

    LAYOUT = "zarr"

    def _column(self, camera: str, column: str) -> Column:
        return Column(self.directory / FOLDER / camera / column)

    def _columns(self, camera: str) -> tuple[str, ...]:
        root = self.directory / FOLDER / camera
        return tuple(sorted(p.parent.relative_to(root).as_posix() for p in root.glob("*/*/zarr.json")))
