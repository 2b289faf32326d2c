"""Converts EventPacket to event_camera_msgs/EventPacket and back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from evis.bag import BagError
from evis.bag.ros import messages
from evis.bag.ros.cdr import RANGE
from evis.bag.ros.messages import Buffers, RosEvents
from evis.bag.threads import ALONE, Threads
from evis.events.codecs.event_camera_msgs import mono
from msgs.camera import EventPacket
from msgs.header import Header

if TYPE_CHECKING:
    from evis.events.codecs.prophesee.evt3 import Encoder

ENCODINGS = ("mono", "evt3")
NAMES = ("t", "x", "y", "p")
_SHARE = 1 << 18
"""Events that a thread packs at a time."""


def _bytes(array: np.ndarray) -> memoryview:
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


def _announce(packet: EventPacket, base_ns: int, encoding: str, events: memoryview) -> RosEvents:
    h = packet.header
    return RosEvents(h.stamp_ns, packet.height, packet.width, h.seq, base_ns, encoding, events)


def decoded(packet: EventPacket) -> bool:
    """Tells whether the packet has its events as arrays."""
    return all(getattr(packet, n) is not None for n in NAMES)


def evt3_encoder() -> Encoder:
    """Makes an encoder for the packets of one topic: a stream to a stateful decoder, and yet each packet decodes
    alone.
    """
    from evis.events.codecs.prophesee.evt3 import Encoder

    return Encoder(resync=True)


def pack(
    packet: EventPacket, frame_id: str, encoder: Encoder | None = None, threads: Threads = ALONE
) -> tuple[list[tuple[str, Buffers]], tuple[str, ...]]:
    """Returns ([(part, bytes)], names of the arrays that the bytes give back).

    A sensor's own bytes stay as they are (part `raw`). Decoded events become `mono`, several packets where their times
    span more than 2^32 ns, or with an `encoder` evt3, whose times are cut to whole us. threads: share large packets.
    Raises BagError.
    """
    parts: list[tuple[str, Buffers]] = []
    exact: tuple[str, ...] = ()
    if packet.raw is not None:
        announced = _announce(packet, max(packet.t0_ns, 0), packet.encoding, _bytes(np.asarray(packet.raw)))
        parts.append(("raw", messages.event_packet(announced, frame_id)))
        exact = ("raw",)
    if not decoded(packet):
        return parts, exact
    t, x, y, p = (np.asarray(getattr(packet, n)) for n in NAMES)
    as_mono = encoder is None or packet.raw is not None
    words = np.empty(len(t) if as_mono else 0, "<u8")
    likely = packet.t0_ns if 0 <= packet.t0_ns < 1 << 62 else 0
    limits = _pack_into(words, t, x, y, p, likely, threads)
    if limits.earliest < 0:
        raise BagError(f"an event at {limits.earliest} ns cannot be recorded: {RANGE}")
    if encoder is not None and not as_mono:
        from evis.events.arrays import Events

        raw = memoryview(encoder.encode(Events(t, x, y, p)))
        return [("evt3", messages.event_packet(_announce(packet, max(packet.t0_ns, 0), "evt3", raw), frame_id))], NAMES
    for first, end, base in mono.split(t, packet.t0_ns, (limits.earliest, limits.latest)):
        run = slice(first, end)
        if base != likely:
            _pack_into(words[run], t[run], x[run], y[run], p[run], base, threads)
        parts.append(("mono", messages.event_packet(_announce(packet, base, "mono", _bytes(words[run])), frame_id)))
    # mono has 15 bits for y and one for p; what does not fit goes into the JSON as well
    whole = {"t": True, "x": True, "y": limits.y <= mono.MAX_Y, "p": limits.p <= 1}
    return parts, (*exact, *(n for n in NAMES if whole[n]))


class _Limits(NamedTuple):
    """Holds of some events the earliest and the latest time, the largest row and polarity."""

    earliest: int
    latest: int
    y: int
    p: int


def _pack_into(
    words: np.ndarray, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, base_ns: int, threads: Threads
) -> _Limits:
    """Packs events into `words`, where there is room for them, and finds their limits while they are in the cache."""

    def of(at: slice) -> _Limits:
        if len(words):
            mono.pack_into(words[at], t[at], x[at], y[at], p[at], base_ns)
        return _Limits(int(t[at].min()), int(t[at].max()), int(y[at].max()), int(p[at].max()))

    if not len(t):
        return _Limits(0, 0, 0, 0)
    shares = [slice(first, min(first + _SHARE, len(t))) for first in range(0, len(t), _SHARE)]
    earliest, *largest = zip(*threads.map(of, shares))
    return _Limits(min(earliest), *map(max, largest))


def unpack(parts: dict[str, list[memoryview]], t_first_ns: int) -> dict[str, np.ndarray]:
    """Unpacks the arrays of the parts that `pack` made; `t_first_ns` as in `summary`."""
    arrays: dict[str, np.ndarray] = {}
    for raw in parts.get("raw", []):
        arrays["raw"] = np.frombuffer(messages.read_event_packet(raw).events, np.uint8)
    for raw in parts.get("evt3", []):
        arrays |= _decode_evt3(messages.read_event_packet(raw), t_first_ns)
    if parts.get("mono"):
        pieces = [_mono(messages.read_event_packet(raw)) for raw in parts["mono"]]
        columns = pieces[0] if len(pieces) == 1 else tuple(np.concatenate(c) for c in zip(*pieces))
        arrays |= dict(zip(NAMES, columns))
    return arrays


def _mono(packet: RosEvents) -> tuple[np.ndarray, ...]:
    if len(packet.events) % 8:
        raise BagError(f"mono events take 8 bytes each, {len(packet.events)} bytes came")
    return mono.unpack(np.frombuffer(packet.events, "<u8"), packet.base_ns)


def _decode_evt3(packet: RosEvents, t_first_ns: int) -> dict[str, np.ndarray]:
    """Decodes the events of a packet, which begins with its own time words; turns of their counter follow from its
    first."""
    from evis.events.codecs.prophesee.evt3 import Decoder

    events = Decoder(packet.width, packet.height).decode(bytes(packet.events))
    turns = t_first_ns // 1000 * 1000 - int(events.t[0]) if len(events) else 0
    return {"t": events.t + turns, "x": events.x, "y": events.y, "p": events.p}


def foreign(raw: memoryview) -> EventPacket:
    """Converts a packet that another program recorded: `mono` is decoded, all else stays raw."""
    packet = messages.read_event_packet(raw)
    header = Header(packet.stamp_ns, packet.seq, "ros")
    fields: dict[str, Any] = {"width": packet.width, "height": packet.height, "t0_ns": packet.stamp_ns}
    if packet.encoding == "mono":
        t, x, y, p = _mono(packet)
        return EventPacket(header, np.array([0, len(t)], np.int64), t=t, x=x, y=y, p=p, **fields)
    events = np.frombuffer(packet.events, np.uint8)
    return EventPacket(header, np.array([0, 0], np.int64), raw=events, encoding=packet.encoding, **fields)


def summary(packet: EventPacket) -> dict[str, int]:
    """Returns counts and first and last time [ns], for the packet's JSON; empty where it is not decoded."""
    if packet.t is None:
        return {}
    t = np.asarray(packet.t)
    ends = {"t_first_ns": int(t[0]), "t_last_ns": int(t[-1])} if len(t) else {}
    return {"events": len(t), **ends}
