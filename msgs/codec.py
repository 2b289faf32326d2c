"""The wire codec: a message as `[msgpack header][array buffer]...`, and back, with every claim of the sender checked.

The header is a msgpack map: `type`, `version`, `header` (stamp_ns, seq, clock, episode), `scalars` (the other plain
fields), `arrays` ([name, dtype, shape] each, in the order of the buffers), and `extra` for the transport. Nothing is
pickled and nothing is evaluated; a hostile header costs at most MAX_HEADER bytes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import msgpack
import numpy as np

import msgs.topics as _all_types  # fills the registry of message types
from msgs.fields import MessageError, array_specs, check_arrays, dtype_name
from msgs.header import Header, Message

assert _all_types

MAX_HEADER = 1 << 20
"""Longest header accepted [bytes]."""
MAX_DIMS = 8

Buffer = bytes | bytearray | memoryview


@dataclass
class WireHeader:
    """A decoded header, before the arrays are attached."""

    message_type: type[Message]
    header: Header
    scalars: dict[str, Any]
    arrays: list[tuple[str, np.dtype, tuple[int, ...]]]
    extra: dict[str, Any]


def contiguous(value: Any) -> np.ndarray:
    """A C-contiguous numpy view of a numpy or Warp array, copied only where it must be."""
    array = value if isinstance(value, np.ndarray) else value.numpy()
    return np.ascontiguousarray(array) if array.ndim else array


def encode_header(message: Message, extra: dict[str, Any] | None = None) -> bytes:
    """The msgpack header of a message. Raises MessageError when the message is not as its type declares."""
    message.check()
    h = message.header
    body = {
        "type": type(message).__name__,
        "version": message.VERSION,
        "header": [int(h.stamp_ns), int(h.seq), h.clock, int(h.episode)],
        "scalars": message.scalars(),
        "arrays": [[n, dtype_name(a), list(a.shape)] for n, a in message.arrays().items()],
    }
    if extra:
        body["extra"] = extra
    try:
        packed = msgpack.packb(body, use_bin_type=True, default=_plain)
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError(f"{body['type']} cannot be packed: {error}") from None
    if len(packed) > MAX_HEADER:
        raise MessageError(f"{body['type']} has a header of {len(packed)} bytes, the limit is {MAX_HEADER}")
    return packed


def _plain(value: Any) -> Any:
    """numpy scalars are plain numbers on the wire."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is not a plain value")


def encode(message: Message) -> list[Buffer]:
    """All frames of a message with its arrays inline."""
    return [encode_header(message), *(memoryview(contiguous(a)).cast("B") if a.size else b"" for a in _arrays(message))]


def _arrays(message: Message) -> list[np.ndarray]:
    return [contiguous(a) for a in message.arrays().values()]


def decode_header(frame: Buffer, expected: type[Message] | None = None) -> WireHeader:
    """Unpack and check a header. `expected`: the type that the topic carries. Raises MessageError."""
    if len(frame) > MAX_HEADER:
        raise MessageError(f"header of {len(frame)} bytes, the limit is {MAX_HEADER}")
    try:
        body = msgpack.unpackb(frame, raw=False, strict_map_key=True)
    except Exception as error:  # msgpack raises several unrelated types on hostile input
        raise MessageError(f"header is not msgpack: {type(error).__name__}: {error}") from None
    if not isinstance(body, dict):
        raise MessageError(f"header is {type(body).__name__}, not a map")
    name = body.get("type")
    message_type = Message.TYPES.get(name) if isinstance(name, str) else None
    if message_type is None:
        raise MessageError(f"unknown message type {name!r}; this side knows {', '.join(sorted(Message.TYPES))}")
    if expected is not None and message_type is not expected:
        raise MessageError(f"the sender publishes {name}, this side expects {expected.__name__}")
    if body.get("version") != message_type.VERSION:
        raise MessageError(
            f"the sender's {name} is version {body.get('version')!r}, this side's is {message_type.VERSION}: "
            "run the same release on both sides"
        )
    extra = body.get("extra", {})
    if not isinstance(extra, dict):
        raise MessageError(f"{name}: extra is not a map")
    return WireHeader(
        message_type, _header(name, body.get("header")), _scalars(message_type, body.get("scalars")),
        [_descriptor(message_type, d) for d in _list(name, "arrays", body.get("arrays"))], extra,
    )


def _list(name: str, key: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise MessageError(f"{name}: {key} is {type(value).__name__}, not a list")
    return value


def _header(name: str, value: Any) -> Header:
    kinds = (int, int, str, int)
    if not isinstance(value, list) or len(value) != 4 or any(type(v) is not k for v, k in zip(value, kinds)):
        raise MessageError(f"{name}: header is {value!r:.80}, not [stamp_ns, seq, clock, episode]")
    if not -(1 << 63) <= value[0] < 1 << 63:
        raise MessageError(f"{name}: stamp {value[0]} ns is not an int64")
    return Header(*value)


_KINDS: dict[str, tuple[type, ...]] = {
    "int": (int,), "float": (float, int), "str": (str,), "bool": (bool,),
    "list[str]": (list,), "dict[str, Any]": (dict,),
}


def _scalars(message_type: type[Message], value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MessageError(f"{message_type.__name__}: scalars is {type(value).__name__}, not a map")
    declared = {f.name: str(f.type) for f in fields(message_type) if "array" not in f.metadata}  # type: ignore[arg-type]
    for key, item in value.items():
        kinds = _KINDS.get(declared.get(key, ""))
        if kinds is None or key == "header":
            raise MessageError(f"{message_type.__name__} has no field {key!r:.80}")
        if not isinstance(item, kinds) or (isinstance(item, bool) and bool not in kinds):
            raise MessageError(f"{message_type.__name__}.{key} is {type(item).__name__}, declared {declared[key]}")
        if declared[key] == "list[str]" and not all(isinstance(s, str) for s in item):
            raise MessageError(f"{message_type.__name__}.{key} holds something that is not a string")
    return value


def _descriptor(message_type: type[Message], value: Any) -> tuple[str, np.dtype, tuple[int, ...]]:
    name = message_type.__name__
    if not isinstance(value, list) or len(value) != 3:
        raise MessageError(f"{name}: array descriptor {value!r:.80} is not [name, dtype, shape]")
    field, dtype, shape = value
    spec = array_specs(message_type).get(field) if isinstance(field, str) else None
    if spec is None:
        raise MessageError(f"{name} has no array {field!r:.80}")
    if dtype not in spec.dtypes:
        raise MessageError(f"{name}.{field} has dtype {dtype!r:.40}, declared {' or '.join(spec.dtypes)}")
    if (
        not isinstance(shape, list)
        or len(shape) > MAX_DIMS
        or any(type(s) is not int or s < 0 or s >= 1 << 48 for s in shape)
    ):
        raise MessageError(f"{name}.{field} has shape {shape!r:.80}")
    return field, np.dtype(dtype), tuple(shape)


def nbytes(descriptor: tuple[str, np.dtype, tuple[int, ...]]) -> int:
    """Bytes that an array of this descriptor takes."""
    return math.prod(descriptor[2]) * descriptor[1].itemsize


def attach(wire: WireHeader, buffers: Sequence[Buffer]) -> Message:
    """Make the message, its arrays being views of `buffers` (read-only where the buffer is). Raises MessageError."""
    name = wire.message_type.__name__
    if len(buffers) != len(wire.arrays):
        raise MessageError(f"{name}: {len(wire.arrays)} arrays announced, {len(buffers)} buffers came")
    arrays: dict[str, np.ndarray] = {}
    for descriptor, buffer in zip(wire.arrays, buffers):
        field, dtype, shape = descriptor
        size = buffer.nbytes if isinstance(buffer, memoryview) else len(buffer)
        if field in arrays:
            raise MessageError(f"{name}.{field} comes twice")
        if size != nbytes(descriptor):
            raise MessageError(f"{name}.{field}: {size} bytes came, {dtype.name} {shape} takes {nbytes(descriptor)}")
        arrays[field] = np.frombuffer(buffer, dtype).reshape(shape) if size else np.empty(shape, dtype)
    check_arrays(wire.message_type, arrays)
    return wire.message_type(wire.header, **arrays, **wire.scalars)  # type: ignore[call-arg]


def decode(frames: Sequence[Buffer], expected: type[Message] | None = None) -> Message:
    """The message of `encode`'s frames. Raises MessageError on anything that is not one."""
    if not frames:
        raise MessageError("no frames")
    return attach(decode_header(frames[0], expected), frames[1:])
