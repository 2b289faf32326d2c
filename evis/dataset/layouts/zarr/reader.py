"""Reads a sequence of Zarr arrays."""

from __future__ import annotations

from typing import Any

from evis.dataset.layouts.columns import ColumnsReader
from evis.dataset.layouts.zarr.package import FOLDER, zarr


class ZarrReader(ColumnsReader):
    """Reads the chunks that are asked for."""

    def _column(self, camera: str, column: str) -> Any:
        return zarr().open_array(str(self.directory / FOLDER / camera / column), mode="r")

    def _columns(self, camera: str) -> tuple[str, ...]:
        root = self.directory / FOLDER / camera
        return tuple(sorted(p.parent.relative_to(root).as_posix() for p in root.glob("*/*/zarr.json")))
