"""Reads a sequence of plain NumPy archives."""

from __future__ import annotations

from typing import Any

from evis.dataset.layouts.columns import ColumnsReader
from evis.dataset.layouts.npz.archive import mapped, opened


class NpzReader(ColumnsReader):
    """Reads parts of the arrays where they lie in the archives."""

    LAYOUT = "npz"

    def _columns(self, camera: str) -> tuple[str, ...]:
        found = []
        for path in sorted((self.directory / camera).glob("*.npz")):
            with opened(path) as archive:
                found += [f"{path.stem}/{name.removesuffix('.npy')}" for name in archive.namelist()]
        return tuple(found)

    def _column(self, camera: str, column: str) -> Any:
        kind, _, name = column.partition("/")
        return mapped(self.directory / camera / f"{kind}.npz", name)
