"""Finds places in MVSEC's table of events, float64 [N, 4] of x, y, t in s and polarity, by time."""

from __future__ import annotations

from typing import Any

import numpy as np


def first_row(table: Any, t_ns: int) -> int:
    """Returns the first row at or after a time; of the file only some chunks are read."""
    step = table.chunks[0] if table.chunks else 1
    low, high = 0, -(-int(table.shape[0]) // step)
    while low < high:  # for the first chunk that begins at or after it
        middle = (low + high) // 2
        if int(nanoseconds(table[middle * step, 2])) < t_ns:
            low = middle + 1
        else:
            high = middle
    if not low:
        return 0
    start = (low - 1) * step
    return start + int(np.searchsorted(nanoseconds(table[start : start + step, 2]), t_ns))


def nanoseconds(seconds: Any) -> np.ndarray:
    """Returns times as int64 ns; float64 s hold them exactly up to 52 days."""
    return np.rint(np.asarray(seconds, np.float64) * 1e9).astype(np.int64)
