"""Writes Zarr (format 3): a group per camera and kind of label, each column an array in compressed chunks."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.dataset.layouts.columns import ColumnsWriter, check_shape
from evis.dataset.layouts.zarr.package import FOLDER, zarr
from evis.files.whole_chunks import WholeChunks

_CHUNK_BYTES = 1 << 20


class ZarrWriter(ColumnsWriter):
    """Writes whole chunks; the rows of the open one wait in memory."""

    LAYOUT = "zarr"

    @classmethod
    def check_installed(cls) -> None:
        """Raises LayoutError without Zarr."""
        zarr()

    def __init__(self, *args: Any) -> None:
        package = zarr()  # before a folder is made
        super().__init__(*args)
        self._root = package.open_group(str(self.directory / FOLDER), mode="w", zarr_format=3)
        self._root.attrs["scene"], self._root.attrs["name"] = self.about.scene, self.about.name
        self._columns: dict[tuple[str, str], tuple[Any, WholeChunks]] = {}

    def _append(self, camera: str, column: str, rows: np.ndarray) -> None:
        if (camera, column) not in self._columns:
            row = max(rows.dtype.itemsize * int(np.prod(rows.shape[1:], dtype=np.int64)), 1)
            chunk = (max(_CHUNK_BYTES // row, 1), *(max(n, 1) for n in rows.shape[1:]))
            array = self._root.create_array(
                f"{camera}/{column}",
                shape=(0, *rows.shape[1:]),
                chunks=chunk,
                dtype=rows.dtype,
                config={"write_empty_chunks": True},  # so that one that is missing is not taken for zeros
            )
            self._columns[camera, column] = array, WholeChunks(array.append, chunk[0])
        array, chunks = self._columns[camera, column]
        check_shape(camera, column, rows, array.shape[1:], array.dtype)
        chunks.add(rows)

    def _finish(self) -> None:
        super()._finish()
        for _, chunks in self._columns.values():
            chunks.flush()
