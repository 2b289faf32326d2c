"""Controls when Python's garbage collector looks for cycles."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Suspends the collector within a block that makes what stays: imports, kernels, scenes.

    It would look through all of that again and again, and find next to nothing. One that was off before stays off.
    """
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()
