"""How a message declares its arrays, and the checks that follow from the declaration."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class ArraySpec:
    """dtype and shape of one array field.

    `dtypes`: allowed numpy dtype names, the first is the usual one. `dims`: names or numbers, one per axis; the same
    name stands for the same length everywhere in one message (`E`, `H`, `W`, ...), `?` for any length.
    """

    dtypes: tuple[str, ...]
    dims: tuple[str | int, ...]
    optional: bool
    doc: str


def array(dtypes: str, dims: str, doc: str = "", *, optional: bool = False) -> Any:
    """Declare an array field: `array("float32|float16", "E H W 3", "radiance")`. Optional fields default to None."""
    spec = ArraySpec(
        tuple(dtypes.split("|")),
        tuple(int(d) if d.isdigit() else d for d in dims.split()),
        optional,
        doc,
    )
    if optional:
        return dataclasses.field(default=None, metadata={"array": spec})
    return dataclasses.field(metadata={"array": spec})


def array_specs(message_type: type) -> dict[str, ArraySpec]:
    """The array fields of a message class, in declaration order."""
    return {f.name: f.metadata["array"] for f in dataclasses.fields(message_type) if "array" in f.metadata}


class MessageError(ValueError):
    """A message that is not what its type declares. The text names the type, the field and both sides."""


def check_arrays(message_type: type, arrays: dict[str, Any]) -> None:
    """Check dtype and shape of every array of one message against its declaration.

    `arrays` maps field name to anything with `dtype` and `shape`. Raises MessageError naming the field, what was
    declared and what is there.
    """
    lengths: dict[str, tuple[int, str]] = {}
    for name, spec in array_specs(message_type).items():
        value = arrays.get(name)
        where = f"{message_type.__name__}.{name}"
        if value is None:
            if spec.optional:
                continue
            raise MessageError(f"{where} is missing")
        dtype = dtype_name(value)
        if dtype not in spec.dtypes:
            raise MessageError(f"{where} has dtype {dtype}, declared {' or '.join(spec.dtypes)}")
        shape = tuple(value.shape)
        if len(shape) != len(spec.dims):
            raise MessageError(f"{where} has shape {shape}, declared [{' '.join(map(str, spec.dims))}]")
        for length, dim in zip(shape, spec.dims):
            if dim == "?":
                continue
            if isinstance(dim, int):
                expected, whence = dim, "declared"
            else:
                expected, whence = lengths.setdefault(dim, (length, name))
            if length != expected:
                raise MessageError(
                    f"{where} has shape {shape}, declared [{' '.join(map(str, spec.dims))}] "
                    f"with {dim} = {expected} ({whence})"
                )


def dtype_name(value: Any) -> str:
    """numpy dtype name of a numpy or Warp array (`float32`); a Warp vector array counts as its scalar."""
    dtype = value.dtype
    if isinstance(dtype, np.dtype):
        return dtype.name
    return np.dtype(value.__array_interface__["typestr"]).name if hasattr(value, "__array_interface__") else str(dtype)
