"""Keeps HDF5 files open in the process that reads them, so that windows that follow each other share chunks."""

from __future__ import annotations

import os
from collections import OrderedDict
from pathlib import Path

import h5py

MOST_OPEN = 16
"""Files that stay open; the one that was not read for the longest time is closed."""
_CHUNK_CACHE_BYTES = 4 << 20
"""Of each array: the chunks in which the next window begins."""
_OPEN: OrderedDict[tuple[int, str, int, int], h5py.File] = OrderedDict()
"""By process, path, time and size: a forked worker opens its own, and a file that was made anew is opened anew."""


def opened(path: Path) -> h5py.File:
    """Returns a file to read from, which others may be reading too; who asks does not close it. Raises OSError."""
    told = path.stat()
    key = os.getpid(), str(path), told.st_mtime_ns, told.st_size
    file = _OPEN.pop(key, None) or h5py.File(path, "r", rdcc_nbytes=_CHUNK_CACHE_BYTES)
    _OPEN[key] = file
    while len(_OPEN) > MOST_OPEN:
        (process, *_), oldest = _OPEN.popitem(last=False)
        if process == key[0]:
            oldest.close()
    return file
