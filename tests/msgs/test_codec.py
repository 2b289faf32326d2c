"""The wire codec: every message type comes back as it went, and nothing but MessageError comes of bad input."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from msgs.camera import Depth, EventPacket, EventSignal, Frames, Keyframe, Samples
from msgs.codec import MAX_DEPTH, MAX_HEADER, attach, decode, decode_header, encode
from msgs.diagnostics import Diagnostics
from msgs.fields import MessageError, TypeMismatch, array_specs, plain_fields
from msgs.header import Header, Message
from msgs.topics import TOPICS
from msgs.world import WorldState

TYPES = sorted({topic.type for topic in TOPICS}, key=lambda t: t.__name__)
relaxed = settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])

int64 = st.integers(-(1 << 63), (1 << 63) - 1)
text = st.text(max_size=8)
plain = st.recursive(
    st.none() | st.booleans() | int64 | st.floats(allow_nan=False) | text,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(text, inner, max_size=3),
    max_leaves=6,
)
SCALARS: dict[str, st.SearchStrategy[Any]] = {
    "int": int64, "float": st.floats(allow_nan=False), "str": text, "bool": st.booleans(),
    "list[str]": st.lists(text, max_size=3), "dict[str, Any]": st.dictionaries(text, plain, max_size=3),
}  # fmt: skip
headers = st.builds(Header, int64, st.integers(0, 1 << 40), text, st.integers(0, 1 << 30))


@st.composite
def messages(draw: st.DrawFn) -> Message:
    """Any message: every type, any lengths (zero too), any dtype that is declared, optional arrays there or not."""
    kind = draw(st.sampled_from(TYPES))
    lengths: dict[str | int, int] = {}
    moving: list[int] = []
    if kind is WorldState:  # of its bodies
        lengths["N"] = draw(st.integers(0, 3))
        moving = sorted(draw(st.sets(st.integers(0, 2)))) if lengths["N"] == 3 else list(range(lengths["N"]))
        lengths["B"] = len(moving)
    if kind is Samples:
        lengths |= {"E": 1, "H": 1, "W": 2}
    arrays = {}
    for name, spec in array_specs(kind).items():
        if spec.optional and draw(st.booleans()):
            continue
        shape = tuple(
            d
            if isinstance(d, int)
            else draw(st.integers(0, 3))
            if d == "?"
            else lengths.setdefault(d, draw(st.integers(0, 3)))
            for d in spec.dims
        )
        dtype = np.dtype(draw(st.sampled_from(spec.dtypes)))
        array = draw(hnp.arrays(dtype, shape))
        if array.ndim > 1 and draw(st.booleans()):
            array = np.asfortranarray(array)  # not as it lies on the wire
        arrays[name] = array
    if kind is WorldState:
        arrays["moving"] = np.array(moving, np.int32)
    if kind is Samples:  # all of the second pixel
        count = len(arrays["offset"])
        arrays["first"], arrays["offset"] = np.array([0, 0, count], np.int32), np.arange(1, count + 1, dtype=np.int32)
    if "env_offsets" in arrays:
        counted = next((arrays[name] for name in ("t", "signal") if name in arrays), ())
        arrays["env_offsets"] = np.linspace(0, len(counted), draw(st.integers(2, 3))).astype(np.int64)
        arrays["env_offsets"][-1] = len(counted)
    scalars = {name: draw(SCALARS[annotation]) for name, annotation in plain_fields(kind).items()}
    return kind(draw(headers), **arrays, **scalars)


def same(a: Message, b: Message) -> bool:
    """Equal in type, header, scalars, and in every byte, dtype and shape of the arrays."""
    x, y = a.arrays(), b.arrays()
    return (
        type(a) is type(b) and a.header == b.header and a.scalars() == b.scalars() and list(x) == list(y)
        and all(x[n].dtype == y[n].dtype and x[n].shape == y[n].shape and x[n].tobytes() == y[n].tobytes() for n in x)
    )  # fmt: skip


def frames_of(message: Message) -> list[bytes]:
    return [bytes(f) for f in encode(message)]


def test_every_type_of_the_table_is_drawn():
    assert len(TYPES) == 22 and {k for t in TYPES for k in plain_fields(t).values()} == set(SCALARS) - {"bool"}


@relaxed
@given(messages())
def test_round_trip(message):
    back = decode(frames_of(message), type(message))
    assert same(message, back)
    back.check()


@relaxed
@given(messages(), st.data())
def test_truncated_or_altered_frames_raise_message_errors_only(message, data):
    frames = frames_of(message)
    i = data.draw(st.integers(0, len(frames) - 1))
    frame = bytearray(frames[i])
    match data.draw(st.sampled_from(["cut", "drop", "double", "swap", "flip"])):
        case "cut":
            frames[i] = bytes(frame[: data.draw(st.integers(0, max(0, len(frame) - 1)))])
        case "drop":
            del frames[i]
        case "double":
            frames.insert(i, frames[i])
        case "swap":
            frames.reverse()
        case "flip" if frame:
            frame[data.draw(st.integers(0, len(frame) - 1))] ^= data.draw(st.integers(1, 255))
            frames[i] = bytes(frame)
    try:
        decode(frames).check()
    except MessageError:
        pass


@relaxed
@given(st.lists(st.binary(max_size=60), max_size=4))
def test_noise_is_a_message_error(frames):
    with pytest.raises(MessageError):
        decode(frames)


hostile_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | st.floats() | text | st.binary(max_size=4)
    | st.sampled_from(["Depth", "float32", "depth", "E", 1, [1, 1, 1]]),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(text | st.integers(0, 3), inner, max_size=3),
    max_leaves=8,
)  # fmt: skip


@settings(deadline=None, max_examples=300)
@given(st.sampled_from(["type", "version", "header", "scalars", "arrays", "extra"]), hostile_values)
def test_any_value_in_any_field_of_the_header(field, value):
    """A well-formed header with one field replaced: read, or refused with a MessageError."""
    frames = frames_of(Depth(Header(1), depth=np.ones((1, 1, 1), np.float32)))
    body = {**msgpack.unpackb(frames[0]), field: value}
    try:
        decode([msgpack.packb(body), *frames[1:]])
    except MessageError:
        pass


def corrupt(**changes: Any) -> list[bytes]:
    frames = frames_of(Depth(Header(1), depth=np.ones((1, 2, 3), np.float32)))
    return [msgpack.packb({**msgpack.unpackb(frames[0]), **changes}), *frames[1:]]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"type": "Deep"}, "unknown message type 'Deep'"),
        ({"type": ["Depth"]}, "unknown message type"),
        ({"version": 2}, "version 2, this side's is 1"),
        ({"header": [1, 2, "sim"]}, "not \\[stamp_ns, seq, clock, episode\\]"),
        ({"header": [1 << 63, 0, "sim", 0]}, "not an int64"),
        ({"header": [True, 0, "sim", 0]}, "not \\[stamp_ns"),
        ({"scalars": {"margin": "2"}}, "Depth.margin is str, declared int"),
        ({"scalars": {"margin": True}}, "Depth.margin is bool"),
        ({"scalars": {"header": 1}}, "has no field 'header'"),
        ({"scalars": {"_slot": 1}}, "has no field '_slot'"),
        ({"arrays": []}, "0 arrays announced, 1 buffers came"),
        ({"arrays": [["depth", "float64", [1, 2, 3]]]}, "dtype 'float64', declared float32"),
        ({"arrays": [["depth", "O", [1, 2, 3]]]}, "dtype 'O'"),
        ({"arrays": [["motion", "float32", [1, 2, 3]]]}, "has no array 'motion'"),
        ({"arrays": [["depth", "float32", [6]]]}, "shape \\(6,\\), declared \\[E H W\\]"),
        ({"arrays": [["depth", "float32", [1, 2, 4]]]}, "24 bytes came"),
        ({"arrays": [["depth", "float32", [1, -2, -3]]]}, "shape"),
        ({"arrays": [["depth", "float32", [1 << 47, 1 << 47, 1 << 47]]]}, "bytes came"),
        ({"arrays": [["depth", "float32", [1] * 9]]}, "shape"),
        ({"extra": 3}, "extra is not a map"),
    ],
)
def test_what_is_wrong_is_named(changes, text):
    with pytest.raises(MessageError, match=text):
        decode(corrupt(**changes))


def test_an_empty_array_with_an_absurd_axis_is_refused():
    frames = corrupt(arrays=[["depth", "float32", [0, 1 << 47, 1 << 47]]])
    with pytest.raises(MessageError, match="shape"):
        decode([frames[0], b""])


def test_extension_types_and_foreign_keys_in_free_fields_are_refused():
    head = frames_of(Diagnostics(Header(0)))[0]
    for value in (msgpack.Timestamp(1), msgpack.ExtType(5, b"x"), {"a": {1: 2}}, {"a": [msgpack.Timestamp(1)]}):
        values = value if isinstance(value, dict) else {"a": value}
        with pytest.raises(MessageError):
            body = {**msgpack.unpackb(head), "scalars": {"values": values}}
            decode([msgpack.packb(body)])


def test_deep_nesting_and_long_headers_are_refused():
    for bomb in (
        b"\x91" * 100_000,
        b"\x81\xa1a" * 100_000,
        bytes(MAX_HEADER + 1),
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff",
        b"\x81" + msgpack.packb("type") + b"\x91" * 1000 + b"\xc0",
    ):
        with pytest.raises(MessageError):
            decode([bomb])
    body = {**msgpack.unpackb(frames_of(Diagnostics(Header(0)))[0]), "scalars": {}}
    for depth in (100, 101, 400, 1000):  # all less than msgpack's limit
        deep = msgpack.packb({"values": {}}).replace(b"\x80", b"\x81\xa1a" * depth + b"\xc0")
        bomb = msgpack.packb(body).replace(msgpack.packb("scalars") + b"\x80", msgpack.packb("scalars") + deep)
        if depth <= MAX_DEPTH:
            decode([bomb])
            continue
        with pytest.raises(MessageError, match="nested too deeply"):
            decode([bomb])
    with pytest.raises(MessageError, match="limit"):
        encode(Diagnostics(Header(0), text="x" * (MAX_HEADER + 1)))


def test_another_type_names_both_sides():
    frames = frames_of(Depth(Header(0), depth=np.zeros((1, 1, 1), np.float32)))
    with pytest.raises(TypeMismatch, match="sender publishes Depth, this side expects Keyframe"):
        decode_header(frames[0], Keyframe)


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (Depth(Header(0), depth=np.zeros((1, 2, 2))), "Depth.depth has dtype float64, declared float32"),
        (Depth(Header(0), depth=np.zeros((1, 2, 2), ">f4")), "dtype >f4"),
        (Depth(Header(0), depth=np.zeros((2, 2), np.float32)), "declared \\[E H W\\]"),
        (Depth(None, depth=np.zeros((1, 2, 2), np.float32)), "header is NoneType"),
        (Diagnostics(Header(0), values={"x": object()}), "object is not a plain value"),
        (Diagnostics(Header(1 << 70)), "cannot be packed"),
        (
            EventPacket(Header(0), np.array([0, 2]), t=np.zeros(2, np.int64), x=np.zeros(1, np.uint16)),
            "with n = 2 \\(t\\)",
        ),
        *(
            (
                EventPacket(Header(0), np.array(offsets, np.int64), np.zeros(2, np.int64)),
                "from 0 to the number of events, 2",
            )
            for offsets in ([0, 1], [0, 3], [1, 2], [0, 2, 1, 2], [0], [])
        ),
        (
            EventSignal(Header(0), np.array([0, 1]), np.zeros(2, np.uint8)),
            "EventSignal.env_offsets is .0, 1., and must",
        ),
    ],
)
def test_a_message_that_is_not_as_declared_is_not_sent(message, text):
    with pytest.raises(MessageError, match=text):
        encode(message)


def test_numpy_scalars_travel_as_numbers():
    message = Diagnostics(
        Header(np.int64(3)), values={"rate_hz": np.float64(2.5), "n": np.int32(7), "on": np.bool_(True)}
    )
    back = decode(frames_of(message))
    assert back.header.stamp_ns == 3 and back.values == {"rate_hz": 2.5, "n": 7, "on": True}
    assert [type(v) for v in back.values.values()] == [float, int, bool]


def test_received_arrays_are_views_and_read_only():
    frames = frames_of(Depth(Header(0), depth=np.arange(6, dtype=np.float32).reshape(1, 2, 3)))
    depth = decode(frames).depth
    assert not depth.flags.owndata and not depth.flags.writeable
    writable = bytearray(frames[1])
    depth = attach(decode_header(frames[0]), [writable]).depth
    writable[:4] = np.float32(9).tobytes()
    assert depth[0, 0, 0] == 9


def test_the_wire_format_is_what_the_docstring_says():
    """Read without our decoder, by msgpack and numpy alone."""
    t, luminance = np.array([5, 9]), np.arange(12, dtype=np.float32).reshape(1, 2, 2, 3)
    message = Frames(Header(9, 3, "sim", 1), t=t, episodes=np.array([1], np.int32), luminance=luminance, filled=4)
    message.reshaded = 6
    head, *buffers = frames_of(message)
    body = msgpack.unpackb(head)
    assert body["type"] == "Frames" and body["version"] == 1 and body["header"] == [9, 3, "sim", 1]
    assert body["scalars"] == {"filled": 4, "reshaded": 6}
    assert body["arrays"] == [["t", "int64", [2]], ["episodes", "int32", [1]], ["luminance", "float32", [1, 2, 2, 3]]]
    assert np.array_equal(np.frombuffer(buffers[2], "<f4").reshape(1, 2, 2, 3), luminance)
    assert np.array_equal(np.frombuffer(buffers[0], "<i8"), t)


def test_message_fields_stay_in_step_with_dataclasses():
    for kind in TYPES:
        names = [f.name for f in dataclasses.fields(kind)]
        assert sorted(names) == sorted(["header", *array_specs(kind), *plain_fields(kind)])


@pytest.mark.parametrize(
    ("first", "offset", "text"),
    [
        ([0, 1], [5, 6], r"Samples.first has 2 entries, 2 pixels take 3"),
        ([0, 1, 1], [5, 6], r"Samples.first does not ascend from 0 to the 2 further samples"),
        ([1, 1, 2], [5, 6], r"Samples.first does not ascend from 0"),
        ([0, 3, 2], [5, 6], r"Samples.first does not ascend from 0"),
        ([0, 2, 2], [6, 6], r"Samples.offset does not ascend from above 0 within each pixel"),
        ([0, 1, 2], [0, 6], r"Samples.offset does not ascend from above 0"),
        ([0, 1, 2], [6, 5], None),
        ([0, 0, 2], [6, 7], None),
    ],
)
def test_lists_of_samples_are_checked(first, offset, text):
    message = Samples(
        Header(10), np.array([10]), np.zeros(1, np.int32), np.array(first, np.int32), np.array(offset, np.int32),
        luminance=np.ones((1, 1, 1, 2), np.float32), further=np.ones(len(offset), np.float32),
    )  # fmt: skip
    if text is None:
        message.check()
    else:
        with pytest.raises(MessageError, match=text):
            message.check()
