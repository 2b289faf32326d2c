"""Saves arrays of a device as plain arrays of numpy, by name, and writes them back: for states that are kept in files.

A Warp array of structs is one plain array for each of their fields, `name.field`, so that a file of it needs no pickle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.gpu.host_copies import host_array


def saved(arrays: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Copies Warp arrays to the host, name -> array; waits for what is launched on a GPU."""
    found: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        values = host_array(array)
        if values.dtype.names is None:
            found[name] = np.array(values)
        else:
            found |= {f"{name}.{field}": np.array(values[field]) for field in values.dtype.names}
    return found


def write_back(arrays: Mapping[str, Any], state: Mapping[str, Any]) -> None:
    """Writes what `saved` gave back into Warp arrays, on their device.

    Raises ValueError naming an array that is missing, that is not known, or whose shape or type is another; nothing is
    written then.
    """
    import warp as wp

    wanted = saved(arrays)
    check_like(wanted, state)
    for name, array in arrays.items():
        if name in wanted:
            values = np.ascontiguousarray(state[name])
        else:
            values = np.array(host_array(array))
            for field in values.dtype.names or ():
                values[field] = state[f"{name}.{field}"]
        wp.copy(array, wp.array(values, dtype=array.dtype, device=array.device))


def check_like(wanted: Mapping[str, Any], state: Mapping[str, Any]) -> None:
    """Raises ValueError where a state has not the names, shapes and types of the arrays that are wanted."""
    if odd := sorted(set(wanted) ^ set(state)):
        raise ValueError(f"it {'lacks' if odd[0] in wanted else 'has an array that nobody knows,'} {odd[0]}")
    for name, own in wanted.items():
        given = np.asarray(state[name])
        if (given.shape, given.dtype) != (own.shape, own.dtype):
            raise ValueError(
                f"its {name} is {given.dtype} {list(given.shape)}, and is {own.dtype} {list(own.shape)} here"
            )


def joined(parts: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Joins the states of parts to one, part -> name -> value, as `part.name`."""
    return {f"{part}.{name}": value for part, state in parts.items() for name, value in state.items()}


def part_of(state: Mapping[str, Any], part: str) -> dict[str, Any]:
    """Gives the state of a part, out of those that `joined` has joined."""
    head = f"{part}."
    return {name.removeprefix(head): state[name] for name in state if name.startswith(head)}
