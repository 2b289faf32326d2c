"""Arrays that lie behind each other in memory, as one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np


def joined(arrays: Sequence[Any]) -> Any:
    """Joins arrays along their first axis, without a copy where they are parts of one that lie behind each other.

    Args:
        arrays: all of numpy or all of Warp on one device, of one dtype, equal in all axes but the first; contiguous.

    Returns:
        An array of their kind; of memory that is theirs, it is valid as long as they are.
    """
    if len(arrays) == 1:
        return arrays[0]
    first, *_ = arrays
    shape = (sum(array.shape[0] for array in arrays), *first.shape[1:])
    # What was allocated apart may lie side by side too, but CUDA copies nothing across that border.
    together = all(_end(a) == _start(b) and _owner(a) is _owner(b) for a, b in pairwise(arrays))
    if isinstance(first, np.ndarray):
        if not together or not all(array.flags.c_contiguous for array in arrays):
            return np.concatenate(arrays)
        return np.lib.stride_tricks.as_strided(first, shape, first.strides)
    import warp as wp

    if together and all(array.is_contiguous for array in arrays):
        view: Any = wp.array(ptr=first.ptr, shape=shape, dtype=first.dtype, device=first.device)
        view.owner_of_memory = first
        return view
    copy: Any = wp.empty(shape, dtype=first.dtype, device=first.device)
    row = 0
    for array in arrays:
        wp.copy(copy[row : row + array.shape[0]], array)
        row += array.shape[0]
    return copy


def _owner(array: Any) -> Any:
    """The object whose memory an array is part of."""
    names = ("base",) if isinstance(array, np.ndarray) else ("owner_of_memory", "_ref")
    parent = next((found for name in names if (found := getattr(array, name, None)) is not None), None)
    return array if parent is None else _owner(parent)


def _start(array: Any) -> int:
    return int(array.__array_interface__["data"][0]) if isinstance(array, np.ndarray) else int(array.ptr)


def _end(array: Any) -> int:
    if isinstance(array, np.ndarray):
        return _start(array) + array.nbytes
    import warp as wp

    return _start(array) + array.size * int(wp.types.type_size_in_bytes(array.dtype))
