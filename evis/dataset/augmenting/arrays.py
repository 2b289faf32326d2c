"""Holds the operations that numpy's arrays and PyTorch's tensors do not call by the same name; a tensor's result stays
on its device."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from evis.random_numbers import FACTORS, GOLDEN, mix

_FACTORS = tuple(int(factor.view(np.int64)) for factor in FACTORS)
_GOLDEN = int(GOLDEN.view(np.int64))


def module_of(array: Any) -> Any:
    """Returns numpy, also for one of its numbers, or torch for a tensor."""
    return np if isinstance(array, np.ndarray | np.generic) else sys.modules["torch"]


def cast(array: Any, dtype: Any) -> Any:
    """Returns the array in another type; dtype is numpy's, or the tensor's own."""
    if isinstance(array, np.ndarray):
        return array.astype(dtype, copy=False)
    return array.to(dtype if not isinstance(dtype, str) else getattr(sys.modules["torch"], dtype))


def order_of(t: Any) -> Any:
    """Returns the order of times, equal ones as they are."""
    return np.argsort(t, kind="stable") if isinstance(t, np.ndarray) else module_of(t).argsort(t, stable=True)


def uniforms(key: np.uint64, stream: int, count: int, like: Any) -> Any:
    """Returns float64 [count] in (0, 1), where `like` is: SplitMix64 as `evis.random_numbers` has it, in int64."""
    with np.errstate(over="ignore"):
        first = int(mix(np.array([key + np.uint64(stream)])).view(np.int64)[0])
    module = module_of(like)
    place = {} if module is np else {"device": like.device}
    z = module.arange(1, count + 1, dtype=module.int64, **place) * _GOLDEN + first
    for shift, factor in zip((30, 27), _FACTORS):
        z = (z ^ _shifted(z, shift)) * factor
    z = z ^ _shifted(z, 31)
    return (cast(_shifted(z, 11), "float64") + 0.5) * 2.0**-53


def _shifted(z: Any, by: int) -> Any:
    """Shifts int64 to the right as if it had no sign."""
    return (z >> by) & ((1 << (64 - by)) - 1)
