"""Joins arrays that lie behind each other in memory to one, and parts them again."""

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


def parted(array: Any, ends: Sequence[int]) -> list[Any]:
    """Splits an array along its first axis, without a copy; a part may be empty, also at the end.

    Warp takes three times as long to make a slice, most of it for questions whose answers are those of the whole.

    Args:
        array: of numpy, or of Warp without a gradient.
        ends: row before which each part ends, ascending; the next one begins there, the first one at 0.

    Returns:
        Arrays of its kind, of its memory.

    Raises ValueError where a part would end beyond the array.
    """
    if len(ends) and ends[-1] > array.shape[0]:
        raise ValueError(f"a part ends before row {ends[-1]} of an array that has {array.shape[0]}")
    rows = pairwise((0, *ends))
    if isinstance(array, np.ndarray):
        return [array[start:end] for start, end in rows]
    kind: Any = type(array)
    whole, at, stride = vars(array), array.ptr, array.strides[0]
    of_row, inner = array.size // max(array.shape[0], 1), array.shape[1:]
    found = []
    for start, end in rows:
        part, count = kind.__new__(kind), end - start
        where = None if at is None else at + start * stride
        own = {"ptr": where, "shape": (count, *inner), "size": count * of_row, "capacity": count * stride}
        vars(part).update(whole, **own, **_ANEW, _ref=array)
        found.append(part)
    return found


_ANEW: dict[str, Any] = {
    "ctype": None, "deleter": None, "_array_interface": None, "_storage_base_ptr": None, "_storage_nbytes": None,
    "_is_read": False,
}  # fmt: skip
"""Attributes of a Warp array that its parts have for themselves."""


def _owner(array: Any) -> Any:
    """Finds the object whose memory an array is part of."""
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
