"""Converts arrays of callers to Warp arrays and back, without a copy: numpy, Warp, PyTorch, whatever speaks DLPack.

PyTorch is never imported here: a caller who hands over a tensor has it loaded.
"""

from __future__ import annotations

import functools
import sys
from typing import Any

import numpy as np
import warp as wp

from evis.warp_start import start_warp

NUMPY, WARP, TORCH = "numpy", "warp", "torch"


def kind_of(values: Any) -> str:
    """Tells whose array this is: numpy (lists too), torch, or warp, which stands for everything else with DLPack."""
    if isinstance(values, wp.array):
        return WARP
    if type(values).__module__.partition(".")[0] == TORCH:
        return TORCH
    return WARP if hasattr(values, "__dlpack__") and not isinstance(values, np.ndarray) else NUMPY


def as_warp(values: Any, dtype: Any = None) -> wp.array:
    """Wraps a caller's array in a Warp array of the same memory, on the device where it lies; lists are copied.

    dtype: of what speaks DLPack, a Warp type that takes its last axis in (vec3f), as Warp's arrays have four at most.
    """
    _start()
    kind = kind_of(values)
    if kind == NUMPY:
        return wp.array(np.ascontiguousarray(values), device="cpu", copy=False)
    if isinstance(values, wp.array):
        return values
    if kind == TORCH and values.requires_grad:
        values = values.detach()
    array: Any = wp.from_dlpack(values, dtype=dtype)
    return array


def cpu_array(values: np.ndarray, dtype: Any = None) -> wp.array:
    """Wraps a numpy array float64 or int32 in a Warp array of the CPU, whose kernels write into the same memory.

    dtype: a Warp type of its numbers that takes its last axis in (vec3d), None where there is none.
    """
    kind = dtype or {"f": wp.float64, "i": wp.int32}[values.dtype.kind]
    there: wp.array = wp.array(values, dtype=kind, device="cpu", copy=False)
    return there


@functools.cache
def _start() -> None:
    """Starts Warp, once: it redirects stderr for a moment."""
    start_warp()


def as_kind(array: wp.array, kind: str) -> Any:
    """Wraps a Warp array in the kind of array that the caller uses, of the same memory."""
    if kind == NUMPY:
        return array.numpy()
    return sys.modules[TORCH].from_dlpack(array) if kind == TORCH else array
