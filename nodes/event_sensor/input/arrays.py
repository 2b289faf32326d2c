"""Converts images of any library to Warp arrays on the sensor's device, without a copy where they are there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import warp as wp


def shape_of(values: Any) -> tuple[int, ...]:
    """Gives the shape in numbers; colour images of Warp, which has four axes at most, are of vec3f."""
    shape = tuple(values.shape)
    return (*shape, 3) if isinstance(values, wp.array) and values.dtype is wp.vec3f else shape


def on_device(values: Any, device: Any) -> wp.array:
    """Gives values as float32 in C order on the device. Raises ValueError.

    values: numpy, Warp, or with __cuda_array_interface__.
    """
    if isinstance(values, wp.array):
        if values.dtype not in (wp.float32, wp.vec3f):
            raise ValueError(f"event sensor got a Warp array of {values.dtype.__name__}, expected float32 or vec3f")
        there = values if values.device == device else values.to(device)
        there = there if there.is_contiguous else there.contiguous()
        return there if there.dtype is wp.float32 else _view(there.ptr, (3 * there.size,), there)
    interface = getattr(values, "__cuda_array_interface__", None)
    if interface is None or not device.is_cuda:
        with np.errstate(over="ignore"):  # what does not fit becomes infinite, which the sensor counts
            flat = np.ascontiguousarray(np.reshape(values, -1), dtype=np.float32)
        return wp.array(flat, dtype=wp.float32, device=device, copy=False)
    shape, kind = tuple(interface["shape"]), interface["typestr"]
    if kind != "<f4":
        raise ValueError(f"event sensor got device memory of type {kind}, expected float32 (<f4)")
    strides, tight = interface.get("strides"), tuple(4 * math.prod(shape[i + 1 :]) for i in range(len(shape)))
    if strides is not None and tuple(strides) != tight:
        raise ValueError("event sensor got device memory that is not contiguous; make a contiguous copy of it")
    return _view(interface["data"][0], (math.prod(shape),), values, device)


def _view(ptr: int, shape: tuple[int, ...], owner: Any, device: Any = None) -> wp.array:
    """Makes a float32 array at `ptr` that keeps the owner of the memory alive."""
    array: Any = wp.array(ptr=ptr, dtype=wp.float32, shape=shape, device=device or owner.device)
    array.owner_of_memory = owner
    return array
