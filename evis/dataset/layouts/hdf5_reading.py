"""Reads parts of HDF5 files, of each its own data alone, and says in a line what is not there, or which package is
not.
"""

from __future__ import annotations

from pathlib import Path

import h5py

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.reader import ANEW
from evis.events.files.hdf5.table import Table, member
from evis.events.recording import RecordingError, RecordingInfo
from evis.files import hdf5_open
from evis.files.allowance import BASE
from evis.files.hdf5_rows import blosc

_BLOSC = 32001
"""Of the filters registered with the HDF Group."""


def opened(path: Path) -> h5py.File:
    """Opens a file to read, which stays open for others. Raises LayoutError for one that is not there, OSError for a
    damaged one."""
    if not path.is_file():
        raise LayoutError(f"{path} is not there; {ANEW}")
    return hdf5_open.opened(path)


def dataset(file: h5py.File, name: str) -> Table:
    """Finds a dataset, of which slices may be read. Raises LayoutError, also for one that lies in another file."""
    if (found := _member(file, name)) is None:
        raise LayoutError(f"{file.filename} has no {name}; {ANEW}")
    if not blosc() and _BLOSC in found.filters:
        raise LayoutError(f"{file.filename} is packed with Blosc, which needs hdf5plugin: pip install 'evis[files]'")
    return found


def has(file: h5py.File, name: str) -> bool:
    """Tells whether there is a dataset of this name. Raises LayoutError for one that lies in another file."""
    return _member(file, name) is not None


def _member(file: h5py.File, name: str) -> Table | None:
    path = Path(file.filename)
    info = RecordingInfo(str(path), "hdf5", "", 0, 0, "", path.stat().st_size)
    try:
        found = member(file, name, info, spare=BASE)
    except RecordingError as error:
        raise LayoutError(str(error)) from None
    return found if isinstance(found, Table) else None
