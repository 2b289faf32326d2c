"""Defines what a server and its followers say to each other, over one XPUB and one SUB socket each.

A follower subscribes to

- GREETING and a text of its own, on each connection anew: it gets HELLO there, as [subscription, hello];
- END: [END, msgpack], once, when the graph has ended;
- for a topic that it wants, `message_key` of it, and before that `every_key` if it wants every message.

Keys of topics have the server's epoch in them, which another start of a server has not: no message of an earlier run
can come to one of a later. A message is [message_key, mark, header, arrays ...] (docs/wire.md).
"""

from __future__ import annotations

import dataclasses
import re
import struct
from dataclasses import dataclass
from typing import Any

import msgpack
import zmq

from evis.bus.wire import type_name
from evis.remote.keys import KeyPair
from evis.runtime.hosting.wiring import system_topic
from evis.runtime.plan import Plan
from msgs.topics import SYSTEM_TOPICS, find_topic

VERSION = 1
GREETING = b"!"
END = b"~"
_EVERY = b"*"
_MARK = struct.Struct("<QB")
_ADDRESS = re.compile(r"tcp://(\[[0-9a-fA-F:.%\w]+\]|[\w.-]+|\*):(\d{1,5}|\*)")

HEARTBEAT_MS, HEARTBEAT_TIMEOUT_MS = 5000, 60000
"""A large message may take a slow network a minute, and an answer to a heartbeat comes behind it."""


class ProtocolError(ConnectionError):
    """Reports that the other side is no server that this follower understands; the text names the remedy."""


def check_address(address: str, bound: bool) -> str:
    """Returns an address tcp://HOST:PORT, as ZeroMQ takes it. Raises ValueError.

    bound: whether it is one to bind, where * is any interface and any free port.
    """
    found = _ADDRESS.fullmatch(address)
    if not found or (not bound and "*" in address) or (found[2] != "*" and int(found[2]) > 65535):
        example = "tcp://0.0.0.0:7447, or tcp://*:* for any" if bound else "tcp://192.168.1.5:7447"
        raise ValueError(f"'{address:.80}' is no address; one is tcp://HOST:PORT, as {example}")
    if not bound and int(found[2]) == 0:
        raise ValueError(f"{address}: a follower must know the port; `evis remote serve` prints it")
    return address


def prepare(sock: zmq.Socket, address: str, key: KeyPair) -> None:
    """Sets what the sockets of both sides have alike: their own keys, and the family of the address."""
    sock.setsockopt(zmq.IPV6, "[" in address)
    sock.curve_publickey, sock.curve_secretkey = key.public, key.secret


def message_key(epoch: bytes, name: str) -> bytes:
    """Makes the first frame of the messages of a topic; as a subscription it is no beginning of another's."""
    return epoch + name.encode() + b"\0"


def every_key(epoch: bytes, name: str) -> bytes:
    """Makes the subscription of who wants every message of a topic."""
    return _EVERY + message_key(epoch, name)


def pack_mark(number: int, every: bool) -> bytes:
    """Packs what a server adds to a message: its number among those sent of the topic, whether it reads every one."""
    return _MARK.pack(number, every)


def unpack_mark(frame: bytes) -> tuple[int, bool]:
    """Returns number and `every` of a message. Raises struct.error."""
    number, every = _MARK.unpack(frame)
    return number, bool(every)


def taps_of(plan: Plan) -> dict[str, str]:
    """Maps the names of all taps of a plan to their topics: of a system topic every process has one of its own."""
    processes = sorted({node.process for node in plan.nodes.values()})
    system = {system_topic(topic, process): topic for topic in SYSTEM_TOPICS for process in processes}
    return {name: name for name in plan.topics} | system


@dataclass(frozen=True)
class Hello:
    """Holds what a server tells each follower first: the start of the server, and the graph, without its secrets."""

    epoch: bytes
    plan: Plan

    def pack(self) -> bytes:
        """Packs it, with the types of all topics."""
        types = {topic: type_name(find_topic(topic).type) for topic in taps_of(self.plan).values()}
        body = {"remote": VERSION, "epoch": self.epoch, "types": types, "plan": self._told().as_json()}
        return msgpack.packb(body, unicode_errors="surrogateescape")

    def _told(self) -> Plan:
        """Makes the plan without its secrets, and without what is of no use to another host."""
        return dataclasses.replace(self.plan.redacted(), directory="")

    @staticmethod
    def unpack(frame: bytes) -> Hello:
        """Unpacks and checks it. Raises ProtocolError."""
        body = _map(frame)
        if body.get("remote") != VERSION:
            theirs = f"{body.get('remote')!r:.20}"
            raise ProtocolError(f"it speaks version {theirs}, this side {VERSION}: run the same release on both sides")
        epoch, types, text = body.get("epoch"), body.get("types"), body.get("plan")
        if type(epoch) is not bytes or len(epoch) != 8 or type(types) is not dict or type(text) is not str:
            raise ProtocolError("what it says first is no description of a graph")
        try:
            plan = Plan.of_json(text)
            ours = {topic: type_name(find_topic(topic).type) for topic in taps_of(plan).values()}
        except Exception as error:  # whatever a plan of another release, or none, leads to
            said = f"{type(error).__name__}: {error}"
            raise ProtocolError(
                f"what it says of its graph cannot be read ({said:.120}): run the same release on both sides"
            ) from None
        for topic, kind in ours.items():
            if types.get(topic) != kind:
                raise ProtocolError(
                    f"its {topic} is {types.get(topic)!r:.40}, this side's is {kind}: run the same release on both "
                    "sides"
                )
        return Hello(epoch, plan)


def pack_end(epoch: bytes) -> bytes:
    """Packs the announcement that the graph has ended."""
    return msgpack.packb({"epoch": epoch})


def ended_epoch(frame: bytes) -> Any:
    """Returns the epoch of the server whose graph has ended. Raises ProtocolError."""
    return _map(frame).get("epoch")


def _map(frame: bytes) -> dict[Any, Any]:
    try:
        body = msgpack.unpackb(frame, unicode_errors="surrogateescape")
    except Exception as error:  # msgpack raises several unrelated types on hostile input
        raise ProtocolError(f"what it says is not msgpack: {type(error).__name__}") from None
    if not isinstance(body, dict):
        raise ProtocolError("what it says is no map")
    return body
