"""Writes messages, or the fields that ROS has no place for, as JSON: readable where possible, always exact.

Small arrays of finite numbers are nested lists (a float's shortest decimal form reads back to the same bits); all
others stand under `<name>_base64` as {dtype, shape, data}. Numbers that JSON lacks are {"$float": "nan"}, bytes are
{"$bytes": base64}, and a map that looks like one of these is {"$map": map}.
"""

from __future__ import annotations

import base64
import binascii
import dataclasses
import json
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from evis.bag import BagError
from evis.files.json_text import parsed
from msgs.fields import ArraySpec, array_specs
from msgs.header import Header, Message

LISTED = 1024
"""Arrays with more numbers than this go as base64."""
_SUFFIX = "_base64"
_TEXT = json.JSONEncoder(ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode


def plain(value: Any) -> Any:
    """Converts a scalar field to a value that JSON can hold."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return {"$float": repr(value)}
    if isinstance(value, (bytes, bytearray, memoryview)):
        return {"$bytes": base64.b64encode(bytes(value)).decode()}
    if isinstance(value, dict):
        body = {str(k): plain(v) for k, v in value.items()}
        return {"$map": body} if len(body) == 1 and next(iter(body)).startswith("$") else body
    if isinstance(value, (list, tuple)):
        return [v if type(v) is str else plain(v) for v in value]  # names of bodies are hundreds
    return value


def unplain(value: Any) -> Any:
    """Reverses `plain`."""
    if isinstance(value, dict):
        if value.keys() == {"$float"}:
            return float(value["$float"])
        if value.keys() == {"$bytes"}:
            return base64.b64decode(value["$bytes"], validate=True)
        if value.keys() == {"$map"}:
            value = value["$map"]
        return {k: unplain(v) for k, v in value.items()}
    return [unplain(v) for v in value] if isinstance(value, list) else value


def _array_member(name: str, array: np.ndarray, spec: ArraySpec) -> tuple[str, str]:
    """Writes an array as the key and the JSON text of an object's member."""
    listable = 0 < array.size <= LISTED and array.dtype.name == spec.dtypes[0] and bool(np.isfinite(array).all())
    if listable:
        return name, _TEXT(array.tolist())
    # An encoder would hold the interpreter while it looks in base64 for what needs an escape.
    data = base64.b64encode(array.tobytes()).decode()
    about = f'"dtype":{_TEXT(array.dtype.name)},"shape":{_TEXT(list(array.shape))}'
    return name + _SUFFIX, f'{{{about},"data":"{data}"}}'


def get_array(body: dict[str, Any], name: str, spec: ArraySpec) -> np.ndarray | None:
    """Takes one array from a JSON object; None where it is absent. Raises BagError."""
    try:
        if name in body:
            return np.array(body[name], dtype=spec.dtypes[0])
        if name + _SUFFIX not in body:
            return None
        packed = body[name + _SUFFIX]
        if packed["dtype"] not in spec.dtypes:
            raise BagError(f"{name} has dtype {packed['dtype']!r:.40}, declared {' or '.join(spec.dtypes)}")
        raw = base64.b64decode(packed["data"], validate=True)
        return np.frombuffer(raw, packed["dtype"]).reshape(packed["shape"])
    except (KeyError, TypeError, ValueError, OverflowError, binascii.Error) as error:
        raise BagError(f"{name} is damaged: {error}") from None


def dump(message: Message, skip: Iterable[str] = (), **extra: Any) -> bytes:
    """Writes a message as JSON, without the fields of `skip`. `extra`: keys for the bag itself, which begin with
    `_`.
    """
    h = message.header
    header = {"stamp_ns": int(h.stamp_ns), "seq": int(h.seq), "clock": h.clock, "episode": int(h.episode)}
    texts = {"header": _TEXT(header)} | {k: _TEXT(plain(v)) for k, v in message.scalars().items() if k not in skip}
    specs = array_specs(type(message))
    arrays = message.arrays().items()
    texts |= dict(_array_member(name, np.asarray(array), specs[name]) for name, array in arrays if name not in skip)
    texts |= {k: _TEXT(v) for k, v in extra.items()}
    return ("{" + ",".join(f'"{k}":{text}' for k, text in texts.items()) + "}").encode()


def parse(raw: bytes | memoryview) -> dict[str, Any]:
    """Parses the JSON object of `dump`. Raises BagError."""
    try:
        body = parsed(bytes(raw))
    except ValueError as error:
        raise BagError(f"a JSON message is damaged: {error}") from None
    if not isinstance(body, dict) or not isinstance(body.get("header"), dict):
        raise BagError("a JSON message is not an object with a header")
    return body


def header_of(body: dict[str, Any]) -> Header:
    """Reads the header of a parsed message. Raises BagError."""
    h = body["header"]
    values = [h.get(k) for k in ("stamp_ns", "seq", "clock", "episode")]
    if [type(v) for v in values] != [int, int, str, int]:
        raise BagError(f"a message's header is {h!r:.80}")
    return Header(*values)  # type: ignore[arg-type]


def load(message_type: type[Message], body: dict[str, Any], arrays: dict[str, np.ndarray]) -> Message:
    """Makes the message of a parsed body; `arrays` are those that were kept elsewhere. Raises BagError."""
    specs = array_specs(message_type)
    values: dict[str, Any] = dict(arrays)
    for name, spec in specs.items():
        array = None if name in values else get_array(body, name, spec)
        if array is not None:
            values[name] = array
    for field in dataclasses.fields(message_type):  # type: ignore[arg-type]
        if field.name in body and field.name not in specs and field.name != "header":
            values[field.name] = unplain(body[field.name])
    try:
        message = message_type(header_of(body), **values)  # type: ignore[call-arg]
        message.check()
    except (TypeError, ValueError) as error:
        raise BagError(str(error)) from None
    return message


_TYPES = {"int": "integer", "float": "number", "str": "string", "bool": "boolean", "list[str]": "array"}


def schema(message_type: type[Message]) -> str:
    """Makes the JSON Schema of a message's JSON form."""
    specs = array_specs(message_type)
    integer = {"type": "integer"}
    properties: dict[str, Any] = {
        "header": {
            "type": "object",
            "properties": {"stamp_ns": integer, "seq": integer, "clock": {"type": "string"}, "episode": integer},
        }
    }
    for field in dataclasses.fields(message_type):  # type: ignore[arg-type]
        if field.name in specs:
            numbers = {"type": "number" if "float" in specs[field.name].dtypes[0] else "integer"}
            items = numbers if len(specs[field.name].dims) == 1 else {"type": "array"}
            properties[field.name] = {"type": "array", "items": items, "description": specs[field.name].doc}
        elif field.name != "header":
            kind = _TYPES.get(str(field.type), "object")
            properties[field.name] = {"type": kind, **({"items": {"type": "string"}} if kind == "array" else {})}
    body = {"title": f"evis/{message_type.__name__}", "type": "object", "properties": properties}
    return json.dumps(body, separators=(",", ":"))
