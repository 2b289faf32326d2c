"""Packs the control messages of a lock-step edge, which are exchanged beside the messages themselves.

DEALER -> ROUTER, one frame each: HELLO (who, what type it expects), READY (whether it can open shared memory, and where
its pipe is), ENDED to answer the end of the stream. ROUTER -> DEALER: WELCOME (with a probe in shared memory, and where
the pipe for credits is) or REFUSED (with the reason). Per message CREDIT (done with it), or TAKEN (next, please; still
kept) and later FREED: through the publisher's pipe, or from DEALER to ROUTER where that cannot be opened.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import msgpack
import zmq

from msgs.codec import Buffer
from msgs.header import Message

HELLO, READY, CREDIT, TAKEN, FREED, ENDED = b"H", b"R", b"C", b"T", b"F", b"E"
WELCOME, REFUSED = b"W", b"X"
END_HEADER = b"END"
"""Marks the end of the stream, in place of a message's header."""

EVERY = b"*"
"""Subscription, beside the topic, of a tap that wants every message of it."""

MAX_TALK = 1 << 16
"""Longest frame that a publisher accepts [bytes]; who sends more is disconnected."""

HEARTBEAT_MS, HEARTBEAT_TIMEOUT_MS = 1000, 5000
"""A peer that does not answer for the second is frozen; a dead one is noticed at once, by its closed connection.

A loaded machine may hold a process for seconds: that is no death. Together less than the supervisor's SILENCE_S."""

SOON_MS = 5
"""A peer that is at work answers through its pipe within this time; only then are the sockets worth a look."""

_MORE = int(zmq.SNDMORE)
_POLLIN = int(zmq.POLLIN)
_SEQ = struct.Struct("<cQ")


class Malformed(ValueError):
    """Reports a frame that does not follow the protocol."""


def pack_seq(op: bytes, seq: int) -> bytes:
    """Packs CREDIT, TAKEN or FREED for one message."""
    return _SEQ.pack(op, seq)


def unpack_seq(frame: bytes) -> tuple[bytes, int]:
    """Returns operation and sequence number. Raises Malformed."""
    if len(frame) != _SEQ.size:
        raise Malformed(f"{len(frame)} bytes")
    return _SEQ.unpack(frame)


def pack_map(op: bytes, **fields: Any) -> bytes:
    """Packs HELLO, READY, WELCOME or REFUSED."""
    return op + msgpack.packb(fields)


def unpack_map(frame: bytes, **kinds: type) -> list[Any]:
    """Returns the named fields of a map frame, each of the given type. Raises Malformed."""
    try:
        fields = msgpack.unpackb(frame[1:])
    except Exception as error:  # msgpack raises several unrelated types on hostile input
        raise Malformed(str(error)) from None
    if not isinstance(fields, dict) or any(type(fields.get(k)) is not kind for k, kind in kinds.items()):
        # Without its value: of maps within maps msgpack unpacks more than Python can print.
        raise Malformed(f"a frame that is no map with {', '.join(kinds)}")
    return [fields[k] for k in kinds]


def type_name(message_type: type[Message]) -> str:
    """Returns a message type's name in the form that both sides compare: `Depth v1`."""
    return f"{message_type.__name__} v{message_type.VERSION}"


def private_key(consumer: str, token: str) -> bytes:
    """Makes the key that one consumer subscribes to beside the topic.

    Its name shows who left, and it can be addressed alone.
    """
    return f"!{consumer};{token}".encode()


def open_socket(context: zmq.Context, kind: int, high_water_mark: int = 0) -> zmq.Socket:
    """Opens a socket with the bus's options: queue length, heartbeats where it has no limit, fast reconnection."""
    sock = context.socket(kind)
    sock.setsockopt(zmq.LINGER, 0)
    sock.setsockopt(zmq.SNDHWM, high_water_mark)
    # An XPUB holds nothing back that it is told: libzmq 4.3.5 may abort when a peer hangs up during that.
    sock.setsockopt(zmq.RCVHWM, 0 if kind == zmq.XPUB else high_water_mark)
    # Behind a full queue heartbeats lie unread: who did not read for some seconds would be taken for dead, and libzmq
    # 4.3.5 aborts a process whose full socket connects anew.
    if not high_water_mark:
        sock.setsockopt(zmq.HEARTBEAT_IVL, HEARTBEAT_MS)
        sock.setsockopt(zmq.HEARTBEAT_TIMEOUT, HEARTBEAT_TIMEOUT_MS)
    sock.setsockopt(zmq.RECONNECT_IVL, 10)
    sock.setsockopt(zmq.RECONNECT_IVL_MAX, 200)
    if kind == zmq.XPUB:
        sock.setsockopt(zmq.XPUB_VERBOSER, 1)
    return sock


def send(sock: zmq.Socket, frames: Sequence[Buffer]) -> None:
    """Sends all frames of one message; pyzmq's own send_multipart takes ten times as long over its checks."""
    for frame in frames[:-1]:
        sock.send(frame, _MORE)
    sock.send(frames[-1])


def readable(sock: zmq.Socket) -> bool:
    """Tells whether the socket is readable; cheaper than any poll."""
    events = sock.getsockopt(zmq.EVENTS)
    return bool(int(events) & _POLLIN)


def poller(*sockets: zmq.Socket | int) -> zmq.Poller:
    """Makes a poller for reading, of sockets and file descriptors."""
    result = zmq.Poller()
    for sock in sockets:
        result.register(sock, zmq.POLLIN)
    return result
