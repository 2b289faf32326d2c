"""Checks which environments a caller names in a reset, and which seeds it gives them, as whole numbers."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np

from msgs.own_time import LARGEST_SEED


def environments_of(envs: Any) -> np.ndarray:
    """Returns the numbers of environments, int64 [R]; whether they are there is for others to judge.

    Raises ValueError for a mask, which would be taken for 0 and 1, and for what are no whole numbers.
    """
    given = _cells(envs)
    if given and all(isinstance(value, (bool, np.bool_)) for value in given):
        raise ValueError("envs of a reset are the numbers of environments and no mask; np.flatnonzero(mask) gives them")
    return np.array(_whole(given, "envs", 0, 2**31 - 1), np.int64)


def seeds_of(seed: Any, following: Sequence[int]) -> list[int]:
    """Returns the seeds of a reset: a single one plus each of `following`, or those given, of which -1 keeps its own.

    Raises ValueError for what are no whole numbers, and for seeds that are negative or above LARGEST_SEED.
    """
    given = _cells(seed)
    if isinstance(seed, (list, tuple)) or np.ndim(seed):
        return _whole(given, "seeds", -1, LARGEST_SEED)
    (first,) = _whole(given, "a seed", 0, LARGEST_SEED - max(following, default=0))
    return [first + k for k in following]


def _cells(values: Any) -> list[Any]:
    try:
        return [*np.asarray(values, object).reshape(-1)]
    except (TypeError, ValueError):  # ragged, or on a GPU
        return [values]


def _whole(given: list[Any], what: str, least: int, most: int) -> list[int]:
    """Reads whole numbers of any type: numpy would cut off fractions and wrap around."""
    found = []
    for value in given:
        try:
            number = least - 1 if isinstance(value, bool) else operator.index(value)
        except TypeError:
            number = least - 1
        if not least <= number <= most:
            raise ValueError(f"a reset has {value!r:.60} for {what}; it takes whole numbers, {least} to {most}")
        found.append(number)
    return found
