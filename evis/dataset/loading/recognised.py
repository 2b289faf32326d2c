"""Recognises which layout a sequence's folder is in, where no dataset.json says so."""

from __future__ import annotations

from pathlib import Path

from evis.dataset.about import FILE
from evis.dataset.errors import DatasetError

MARKS = {
    "dsec": "events/left/events.h5",
    "zarr": "sequence.zarr",
    "mcap": "sequence.mcap",
    "coco": "annotations/instances.json",
    "mvsec": "*_data.hdf5",
    "webdataset": "000000.tar",
    "npz": "*/events.npz",
}
"""Layout -> what only its folders have."""


def is_sequence(folder: Path) -> bool:
    """Says whether a folder is one sequence."""
    return (folder / FILE).is_file()


def layout_of(folder: Path) -> str:
    """Returns the layout of a sequence's folder. Raises DatasetError."""
    for layout, mark in MARKS.items():
        if any(folder.glob(mark)):
            return layout
    raise DatasetError(f"{folder} is a sequence in none of the layouts {', '.join(MARKS)}; make or export it anew")
