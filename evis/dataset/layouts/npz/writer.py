"""Writes plain NumPy archives: `<camera>/events.npz`, which `evis.open` reads too, and `<camera>/<kind>.npz`.

The arrays are not compressed, so that a part of one is read without the rest.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evis.dataset.layouts.columns import ColumnsWriter, check_shape
from evis.dataset.layouts.npz.archive import pack
from evis.dataset.layouts.npz.growing_npy import GrowingNpy

_PART = ".part.npy"


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
