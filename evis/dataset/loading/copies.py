"""Copies sequences that lie where fsspec reaches to this machine at their first use, once in each process."""

from __future__ import annotations

import atexit
import contextlib
import functools
from pathlib import Path

from evis.dataset.making.store import is_remote, store_of

_COPIES = contextlib.ExitStack()
"""What is copied stays until the process ends; a forked worker, which leaves without this, removes nothing of it."""
atexit.register(_COPIES.close)


def local_folder(out: str, path: str) -> Path:
    """Returns the folder of a sequence on this machine. Raises DatasetError, OSError."""
    return copied(out, path) if is_remote(out) else Path(out, path)


@functools.cache
def copied(out: str, path: str) -> Path:
    """Copies a sequence here, once. Raises DatasetError, OSError."""
    return _COPIES.enter_context(store_of(out).local(path))
