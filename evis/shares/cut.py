"""Cuts a message of some neighbouring environments out of one of all."""

from __future__ import annotations

from typing import Any

from msgs.fields import array_specs, environment_key
from msgs.header import Message


def can_be_cut(message_type: type[Message]) -> bool:
    """Tells whether messages of a type say of all their arrays which environments these are of."""
    dims = [spec.dims[0] for spec in array_specs(message_type).values()]
    return "E" in dims and "?" not in dims


def environments(message: Message) -> int:
    """Counts the environments of a message that can be cut."""
    specs = array_specs(type(message))
    return next(len(array) for name, array in message.arrays().items() if specs[name].dims[0] == "E")


def cut(message: Message, envs: slice) -> dict[str, Any]:
    """Returns the arrays of some neighbouring environments, by name; the others hold for all and stay as they are.

    Rows of tables, as the contacts of a state, tell their environment, which is counted from the first one here.
    """
    specs, arrays = array_specs(type(message)), message.arrays()
    found: dict[str, Any] = {}
    for name, array in arrays.items():
        key = environment_key(name, type(message))
        if specs[name].dims[0] == "E":
            found[name] = array[envs]
        elif key in arrays:
            rows = (arrays[key] >= envs.start) & (arrays[key] < envs.stop)
            found[name] = (array[rows] - envs.start).astype(array.dtype) if name == key else array[rows]
        else:
            found[name] = array
    return found
