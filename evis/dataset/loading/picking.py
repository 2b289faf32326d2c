"""Picks the label that belongs to a window of time."""

from __future__ import annotations

import numpy as np

from evis.dataset.augmenting.augmentation import COUNTERPART

_US = 1000
"""Times are compared in whole us, as some layouts hold no more of a stamp."""


def at_end(stamps: np.ndarray, t0: np.ndarray, t1: np.ndarray) -> np.ndarray:
    """Returns which label is the last one of each window, with a stamp in (t0, t1]; -1 where there is none.

    Args:
        stamps: int64 [T, 2] ns, ascending, the beginning and the end of what each label is of.
        t0, t1: int64 [n] ns.
    """
    ends = stamps[:, 1] // _US
    last = np.searchsorted(ends, t1 // _US, "right") - 1
    there = (last >= 0) & (ends[np.maximum(last, 0)] > t0 // _US) if len(ends) else np.zeros(len(t0), bool)
    return np.where(there, last, -1)


def at_start(stamps: np.ndarray, t0: np.ndarray, t1: np.ndarray) -> np.ndarray:
    """Returns which label is the last one of each window where time runs backwards: the first that begins in [t0, t1).

    -1 where there is none; arguments as those of `at_end`.
    """
    begins = stamps[:, 0] // _US
    first = np.searchsorted(begins, t0 // _US, "left")
    there = first < len(begins)
    there &= begins[np.where(there, first, 0)] < t1 // _US if len(begins) else False
    return np.where(there, first, -1)


def with_interval(kind: str, stamps: np.ndarray) -> np.ndarray:
    """Returns the numbers of the labels that cover an interval: at the start of a run none has passed yet."""
    if kind in COUNTERPART:
        return np.flatnonzero(stamps[:, 1] > stamps[:, 0])
    return np.arange(len(stamps))
