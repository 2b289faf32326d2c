"""Reads parts of HDF5 files, and says in a line what is not there, or which package is not."""

from __future__ import annotations

from pathlib import Path

import h5py

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.hdf5_rows import blosc
from evis.dataset.layouts.reader import ANEW
from evis.files import hdf5_open

_BLOSC = 32001
"""Of the filters registered with the HDF Group."""


def opened(path: Path) -> h5py.File:
    """Opens a file to read, which stays open for others. Raises LayoutError for one that is not there, OSError for a
    damaged one."""
    if not path.is_file():
        raise LayoutError(f"{path} is not there; {ANEW}")
    return hdf5_open.opened(path)


def dataset(file: h5py.File, name: str) -> h5py.Dataset:
    """Finds a dataset, of which slices may be read. Raises LayoutError."""
    if not isinstance(found := file.get(name), h5py.Dataset):
        raise LayoutError(f"{file.filename} has no {name}; {ANEW}")
    filters = found.id.get_create_plist()
    if not blosc() and any(filters.get_filter(k)[0] == _BLOSC for k in range(filters.get_nfilters())):
        raise LayoutError(f"{file.filename} is packed with Blosc, which needs hdf5plugin: pip install 'evis[files]'")
    return found
