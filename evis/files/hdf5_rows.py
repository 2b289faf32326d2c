"""Writes arrays of an HDF5 file that grow, compressed with Blosc where hdf5plugin is there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from evis.files.whole_chunks import WholeChunks

_CHUNK_BYTES = 1 << 18
NO_BLOSC = (
    "hdf5plugin is not installed: compressed with gzip, which every HDF5 reader knows (pip install 'evis[files]')"
)


def blosc() -> Mapping[str, Any]:
    """Returns h5py's arguments for Blosc with zstd, as DSEC has it; empty without hdf5plugin.

    Importing it also lets h5py read such files.
    """
    try:
        import hdf5plugin
    except ImportError:
        return {}
    compression: Mapping[str, Any] = hdf5plugin.Blosc(cname="zstd", clevel=1, shuffle=hdf5plugin.Blosc.SHUFFLE)
    return compression


class GrowingRows:
    """Makes a dataset whose first axis grows; the rows of an open chunk wait in memory."""

    def __init__(self, group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any, **compression: Any) -> None:
        row = max(np.dtype(dtype).itemsize * int(np.prod(shape, dtype=np.int64)), 1)
        chunk = max(_CHUNK_BYTES // row, 1)
        self._data = group.create_dataset(
            name, (0, *shape), dtype, maxshape=(None, *shape), chunks=(chunk, *shape), **compression
        )
        self._chunks = WholeChunks(self._put, chunk)
        self.add, self.flush = self._chunks.add, self._chunks.flush

    def _put(self, rows: np.ndarray) -> None:
        count = self._data.shape[0]
        self._data.resize(count + len(rows), axis=0)
        self._data[count:] = rows
