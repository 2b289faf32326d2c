"""Imports the package zarr, an extra."""

from __future__ import annotations

from typing import Any

from evis.dataset.layouts import LayoutError

FOLDER = "sequence.zarr"


def zarr() -> Any:
    """Returns the package. Raises LayoutError where it is not installed."""
    try:
        import zarr as package
    except ImportError:
        raise LayoutError("the layout zarr needs the package zarr: pip install 'evis[layouts]'") from None
    return package
