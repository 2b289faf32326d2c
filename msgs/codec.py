"""Encodes a message as `[msgpack header][array buffer]...` and decodes it, with every claim of the sender checked.

The header is a msgpack map: `type`, `version`, `header` (stamp_ns, seq, clock, episode), `scalars` (the other plain
fields), `arrays` ([name, dtype, shape] each, in the order of the buffers), and `extra` for the transport. Nothing is
pickled and nothing is evaluated; a hostile header costs at most MAX_HEADER bytes. A transport whose messages differ in
nothing but their moment may send a header once more, and behind it three int64: stamp_ns, seq, episode.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np

import msgs.topics as _all_types  # fills the registry of message types
from msgs.fields import MessageError, TypeMismatch, array_specs, check_arrays, dtype_name, plain_fields
from msgs.header import Header, Message

assert _all_types

MAX_HEADER = 1 << 20
"""Longest header accepted [bytes]."""
MAX_DEPTH = 100
"""Lists and maps within each other in a map of plain values; how deep Python itself goes depends on its version."""
MAX_DIMS = 8

MAX_PASSED = 1024
"""Layouts remembered as checked."""

Buffer = bytes | bytearray | memoryview
Layout = tuple[tuple[str, np.dtype, tuple[int, ...]], ...]
_MOMENT = struct.Struct("<qqq")
_passed: set[tuple[type[Message], Layout]] = set()
_latest: dict[type[Message], Layout] = {}
"""What has passed last of each type."""


@dataclass
class WireHeader:
    """Holds a decoded header, before the arrays are attached."""

    message_type: type[Message]
    header: Header
    scalars: dict[str, Any]
    arrays: list[tuple[str, np.dtype, tuple[int, ...]]]
    extra: dict[str, Any]


def contiguous(array: np.ndarray) -> np.ndarray:
    """Returns an array in C order, copied only where it must be."""
    return array if array.flags.c_contiguous else np.ascontiguousarray(array)


def checked(message: Message) -> dict[str, np.ndarray]:
    """Returns the arrays of a message as they lie in memory, checked against its type. Raises MessageError."""
    if not isinstance(message.header, Header):
        raise MessageError(f"{type(message).__name__}.header is {type(message.header).__name__}, not Header")
    arrays = {
        name: value if isinstance(value, np.ndarray) else _on_host(message, name, value)
        for name, value in message.arrays().items()
    }
    check_layout(type(message), arrays)
    message.check_values()
    return arrays


def _on_host(message: Message, name: str, value: Any) -> np.ndarray:
    """What is no array of numpy's: one of Warp's, or a mistake."""
    if not hasattr(value, "numpy"):
        field, kind = f"{type(message).__name__}.{name}", type(value).__name__
        raise MessageError(f"{field} is a value of type {kind}, and must be an array: numpy.array makes one")
    return value.numpy()


def contents(message: Message) -> dict[str, np.ndarray]:
    """Returns the arrays of a message as they go on the wire, checked against its type. Raises MessageError."""
    return {name: contiguous(array) for name, array in checked(message).items()}


def layout(arrays: Mapping[str, np.ndarray]) -> Layout:
    """Describes arrays by names, dtypes and shapes; most topics never change theirs."""
    return tuple([(name, array.dtype, array.shape) for name, array in arrays.items()])


def check_layout(message_type: type[Message], arrays: Mapping[str, np.ndarray]) -> None:
    """Checks arrays as `check_arrays` does, remembering what has passed. Raises MessageError."""
    found = layout(arrays)
    if _latest.get(message_type) == found:  # to compare dtypes is quick, to hash them is not
        return
    key = message_type, found
    if key not in _passed:
        check_arrays(message_type, dict(arrays))
        if len(_passed) >= MAX_PASSED:
            _passed.clear()
        _passed.add(key)
    _latest[message_type] = found


def pack_header(message: Message, arrays: Mapping[str, np.ndarray], extra: dict[str, Any] | None = None) -> bytes:
    """Packs the msgpack header of a message with these `contents`. Raises MessageError."""
    h = message.header
    name = type(message).__name__
    body = {
        "type": name,
        "version": message.VERSION,
        "header": [int(h.stamp_ns), int(h.seq), h.clock, int(h.episode)],
        "scalars": message.scalars(),
        "arrays": [[n, dtype_name(a), a.shape] for n, a in arrays.items()],
    }
    if extra:
        body["extra"] = extra
    return _pack(name, body)


def pack_scalars(message: Message) -> bytes:
    """Packs the scalars alone; two messages have the same where these bytes are the same. Raises MessageError."""
    return _pack(type(message).__name__, message.scalars())


def pack_moment(header: Header) -> bytes:
    """Packs stamp, sequence number and episode: what follows a header that is sent once more. Raises MessageError."""
    try:
        return _MOMENT.pack(int(header.stamp_ns), int(header.seq), int(header.episode))
    except struct.error as error:
        raise MessageError(f"{header!r:.200} cannot be packed: {error}") from None


def _pack(name: str, body: Any) -> bytes:
    try:
        packed = msgpack.packb(body, default=_plain)
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError(f"{name} cannot be packed: {error}") from None
    if len(packed) > MAX_HEADER:
        raise MessageError(f"{name} has a header of {len(packed)} bytes, the limit is {MAX_HEADER}")
    return packed


def _plain(value: Any) -> Any:
    """numpy scalars are plain numbers on the wire."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is not a plain value")


def raw(array: np.ndarray) -> Buffer:
    """Returns the bytes of a contiguous array, in place."""
    return array.data.cast("B") if array.size else b""


def encode(message: Message) -> list[Buffer]:
    """Encodes all frames of a message with its arrays inline."""
    arrays = contents(message)
    return [pack_header(message, arrays), *map(raw, arrays.values())]


def decode_header(frame: Buffer, expected: type[Message] | None = None) -> WireHeader:
    """Unpacks and checks a header. `expected`: the type that the topic carries. Raises MessageError, TypeMismatch."""
    if len(frame) > MAX_HEADER:
        raise MessageError(f"header of {len(frame)} bytes, the limit is {MAX_HEADER}")
    try:
        return _decode_header(frame, expected)
    except RecursionError:  # msgpack unpacks what Python cannot even print
        raise MessageError("header is nested too deeply") from None


def _decode_header(frame: Buffer, expected: type[Message] | None) -> WireHeader:
    try:
        body = msgpack.unpackb(frame)
    except Exception as error:  # msgpack raises several unrelated types on hostile input
        raise MessageError(f"header is not msgpack: {type(error).__name__}: {error}") from None
    if not isinstance(body, dict):
        raise MessageError(f"header is {type(body).__name__}, not a map")
    name = body.get("type")
    message_type = Message.TYPES.get(name) if isinstance(name, str) else None
    if message_type is None or not isinstance(name, str):
        raise MessageError(f"unknown message type {name!r:.80}; this side knows {', '.join(sorted(Message.TYPES))}")
    if expected is not None and message_type is not expected:
        raise TypeMismatch(f"the sender publishes {name}, this side expects {expected.__name__}")
    if body.get("version") != message_type.VERSION:
        raise TypeMismatch(
            f"the sender's {name} is version {body.get('version')!r:.80}, this side's is {message_type.VERSION}: "
            "run the same release on both sides"
        )
    extra = body.get("extra", {})
    if not isinstance(extra, dict):
        raise MessageError(f"{name}: extra is not a map")
    return WireHeader(
        message_type, _header(name, body.get("header")), _scalars(message_type, body.get("scalars")),
        [_descriptor(message_type, d) for d in _list(name, "arrays", body.get("arrays"))], extra,
    )  # fmt: skip


def decode_moment(frame: Buffer, clock: str) -> Header:
    """Decodes the header of `pack_moment`. Raises MessageError."""
    if len(frame) != _MOMENT.size:
        raise MessageError(f"stamp, sequence number and episode in {len(frame)} bytes, not {_MOMENT.size}")
    stamp_ns, seq, episode = _MOMENT.unpack(frame)
    if seq < 0:
        raise MessageError(f"sequence number {seq} is not a count")
    return Header(stamp_ns, seq, clock, episode)


def _list(name: str, key: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise MessageError(f"{name}: {key} is {type(value).__name__}, not a list")
    return value


def _header(name: str, value: Any) -> Header:
    if not isinstance(value, list) or [type(v) for v in value] != [int, int, str, int]:
        raise MessageError(f"{name}: header is {value!r:.80}, not [stamp_ns, seq, clock, episode]")
    if not -(1 << 63) <= value[0] < 1 << 63:
        raise MessageError(f"{name}: stamp {value[0]} ns is not an int64")
    if not 0 <= value[1] < 1 << 63:
        raise MessageError(f"{name}: sequence number {value[1]} is not a count")
    return Header(*value)


_KINDS: dict[str, tuple[type, ...]] = {
    "int": (int,), "float": (float, int), "str": (str,), "bool": (bool,),
    "list[str]": (list,), "dict[str, Any]": (dict,),
}  # fmt: skip
_PLAIN = (type(None), bool, int, float, str, bytes)


def _scalars(message_type: type[Message], value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MessageError(f"{message_type.__name__}: scalars is {type(value).__name__}, not a map")
    declared = plain_fields(message_type)
    for key, item in value.items():
        kind = declared.get(key)
        if kind is None:
            raise MessageError(f"{message_type.__name__} has no field {key!r:.80}")
        if type(item) not in _KINDS[kind]:
            raise MessageError(f"{message_type.__name__}.{key} is {type(item).__name__}, declared {kind}")
        if kind == "list[str]" and not all(type(s) is str for s in item):
            raise MessageError(f"{message_type.__name__}.{key} holds something that is not a string")
        if kind == "dict[str, Any]" and not _is_plain(item):
            raise MessageError(f"{message_type.__name__}.{key} holds something that is not a plain value")
    return value


def _is_plain(value: Any, depth: int = MAX_DEPTH) -> bool:
    """Numbers, text, bytes, lists, and maps by text; not msgpack's extension types. Raises MessageError below depth."""
    if type(value) not in (dict, list):
        return type(value) in _PLAIN
    if depth == 0:
        raise MessageError("header is nested too deeply")
    if type(value) is dict:
        return all(type(k) is str and _is_plain(v, depth - 1) for k, v in value.items())
    return all(_is_plain(v, depth - 1) for v in value)


def _descriptor(message_type: type[Message], value: Any) -> tuple[str, np.dtype, tuple[int, ...]]:
    if type(value) is not list or len(value) != 3:
        raise MessageError(f"{message_type.__name__}: array descriptor {value!r:.80} is not [name, dtype, shape]")
    field, dtype, shape = value
    spec = array_specs(message_type).get(field) if type(field) is str else None
    if spec is None:
        raise MessageError(f"{message_type.__name__} has no array {field!r:.80}")
    where = f"{message_type.__name__}.{field}"
    if type(dtype) is not str or dtype not in spec.dtypes:
        raise MessageError(f"{where} has dtype {dtype!r:.40}, declared {' or '.join(spec.dtypes)}")
    if type(shape) is not list or len(shape) > MAX_DIMS:
        raise MessageError(f"{where} has shape {shape!r:.80}")
    for length in shape:
        if type(length) is not int or not 0 <= length < 1 << 48:
            raise MessageError(f"{where} has shape {shape!r:.80}")
    return field, np.dtype(dtype), tuple(shape)


def nbytes(descriptor: tuple[str, np.dtype, tuple[int, ...]]) -> int:
    """Returns the bytes that an array of this descriptor takes."""
    return math.prod(descriptor[2]) * descriptor[1].itemsize


def attach(wire: WireHeader, buffers: Sequence[Buffer]) -> Message:
    """Makes the message, its arrays being views of `buffers` (read-only where the buffer is). Raises MessageError."""
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
        arrays[field] = np.ndarray(shape, dtype, buffer) if size else _empty(name, field, shape, dtype)
    check_layout(wire.message_type, arrays)
    return wire.message_type(wire.header, **arrays, **wire.scalars)  # type: ignore[call-arg]


def _empty(name: str, field: str, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    try:
        return np.empty(shape, dtype)
    except ValueError as error:  # some other axis is absurdly long
        raise MessageError(f"{name}.{field} has shape {shape}: {error}") from None


def decode(frames: Sequence[Buffer], expected: type[Message] | None = None) -> Message:
    """Decodes the message of `encode`'s frames. Raises MessageError on anything that is not one."""
    if not frames:
        raise MessageError("no frames")
    return attach(decode_header(frames[0], expected), frames[1:])
