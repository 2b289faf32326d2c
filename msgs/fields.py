"""Lets a message declare its arrays, and makes the checks that follow from the declaration."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np


@dataclass(frozen=True)
class ArraySpec:
    """Declares dtype and shape of one array field.

    `dtypes`: allowed numpy dtype names, the first is the usual one. `dims`: names or numbers, one per axis; the same
    name stands for the same length everywhere in one message (`E`, `H`, `W`, ...), `?` for any length.
    """

    dtypes: tuple[str, ...]
    dims: tuple[str | int, ...]
    optional: bool
    doc: str

    @cached_property
    def accepted(self) -> frozenset[np.dtype]:
        """Returns `dtypes` as numpy has them, in this machine's byte order."""
        return frozenset(np.dtype(name) for name in self.dtypes)


def array(dtypes: str, dims: str, doc: str = "", *, optional: bool = False) -> Any:
    """Declares an array field: `array("float32|float16", "E H W 3", "radiance")`. Optional fields default to None."""
    spec = ArraySpec(
        tuple(dtypes.split("|")),
        tuple(int(d) if d.isdigit() else d for d in dims.split()),
        optional,
        doc,
    )
    if optional:
        return dataclasses.field(default=None, metadata={"array": spec})
    return dataclasses.field(metadata={"array": spec})


_specs: dict[type, dict[str, ArraySpec]] = {}
_plain: dict[type, dict[str, str]] = {}


def array_specs(message_type: type) -> dict[str, ArraySpec]:
    """Returns the array fields of a message class, in declaration order. The dict is shared: do not change it."""
    specs = _specs.get(message_type)
    if specs is None:
        fields = dataclasses.fields(message_type)
        specs = _specs[message_type] = {f.name: f.metadata["array"] for f in fields if "array" in f.metadata}
    return specs


def environment_key(name: str, message_type: type) -> str:
    """Names the array that tells the environment of each row of table array `name` (`box_env` of `box_id`), or ""."""
    specs = array_specs(message_type)
    key = name.split("_")[0] + "_env"
    return key if key in specs and specs[name].dims[0] == specs[key].dims[0] else ""


def by_environment(message_type: type) -> bool:
    """Says whether the first axis of all arrays of a message class is the environments'."""
    return all(spec.dims[0] == "E" for spec in array_specs(message_type).values())


def plain_fields(message_type: type) -> dict[str, str]:
    """Returns the other fields of a message class but `header`, in order: name -> annotation. Do not change it."""
    plain = _plain.get(message_type)
    if plain is None:
        others = (f for f in dataclasses.fields(message_type) if "array" not in f.metadata and f.name != "header")
        plain = _plain[message_type] = {f.name: str(f.type) for f in others}
    return plain


class MessageError(ValueError):
    """Reports a message that is not what its type declares. The text names the type, the field and both sides."""


class TypeMismatch(MessageError):
    """Reports a message of another type, or another version of it, than this side expects."""


def check_arrays(message_type: type, arrays: dict[str, Any]) -> None:
    """Checks dtype and shape of every array of one message against its declaration.

    `arrays` maps field name to anything with `dtype` and `shape`. Raises MessageError naming the field, what was
    declared and what is there.
    """
    lengths: dict[str, tuple[int, str]] = {}
    for name, spec in array_specs(message_type).items():
        value = arrays.get(name)
        if value is None:
            if spec.optional:
                continue
            raise MessageError(f"{_where(message_type, name)} is missing")
        if value.dtype not in spec.accepted and (dtype := dtype_name(value)) not in spec.dtypes:
            raise MessageError(f"{_where(message_type, name)} has dtype {dtype}, declared {' or '.join(spec.dtypes)}")
        shape = value.shape
        if len(shape) != len(spec.dims):
            raise _shape_error(message_type, name, shape)
        for length, dim in zip(shape, spec.dims):
            if dim == "?":
                continue
            if isinstance(dim, int):
                expected, whence = dim, "declared"
            else:
                expected, whence = lengths.setdefault(dim, (length, name))
            if length != expected:
                raise _shape_error(message_type, name, shape, f" with {dim} = {expected} ({whence})")


def _where(message_type: type, name: str) -> str:
    return f"{message_type.__name__}.{name}"


def _shape_error(message_type: type, name: str, shape: tuple[int, ...], why: str = "") -> MessageError:
    declared = " ".join(map(str, array_specs(message_type)[name].dims))
    return MessageError(f"{_where(message_type, name)} has shape {tuple(shape)}, declared [{declared}]{why}")


def dtype_name(value: Any) -> str:
    """Names the numpy dtype of a numpy or Warp array (`float32`); a Warp vector array counts as its scalar.

    A foreign byte order is part of the name (`>f4`): the wire has this machine's.
    """
    dtype = value.dtype
    if not isinstance(dtype, np.dtype):
        if not hasattr(value, "__array_interface__"):
            return str(dtype)
        dtype = np.dtype(value.__array_interface__["typestr"])
    return _name(dtype)


@cache
def _name(dtype: np.dtype) -> str:
    return dtype.name if dtype.isnative else dtype.str
