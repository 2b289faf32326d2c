"""Reads and writes messages of the protocol foxglove.websocket.v1.

Source: github.com/foxglove/ws-protocol, docs/spec.md. foxglove.sdk.v1 is the same wire for what is used here.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

SUBPROTOCOLS = ("foxglove.websocket.v1", "foxglove.sdk.v1")
MOST_BYTES = 1 << 16
"""Longest message of a client."""
LARGEST_ID = (1 << 32) - 1
"""Ids of subscriptions are uint32 in the messages that carry data."""
INFO, WARNING, ERROR = 0, 1, 2
"""Levels of a status."""
_MESSAGE_DATA, _TIME = 1, 2
_LONGEST_STATUS = 300


def server_info(name: str, session: str, metadata: Mapping[str, str]) -> str:
    """Writes what a client is told first. session: tells a new run from one that it was connected to before."""
    body = {"op": "serverInfo", "name": name, "capabilities": ["time"], "metadata": metadata, "sessionId": session}
    return json.dumps(body)


def advertise(channels: Sequence[Mapping[str, Any]]) -> str:
    """Writes the channels that have come."""
    return json.dumps({"op": "advertise", "channels": channels})


def status(level: int, text: str) -> str:
    """Writes a line for the user."""
    return json.dumps({"op": "status", "level": level, "message": text[:_LONGEST_STATUS]})


def message_data(subscription: int, time_ns: int, payload: bytes) -> bytes:
    """Writes one message of a channel. time_ns: when it counts as received [ns], >= 0."""
    return struct.pack("<BIQ", _MESSAGE_DATA, subscription, time_ns) + payload


def time_message(time_ns: int) -> bytes:
    """Writes the time that the graph has come to [ns], >= 0."""
    return struct.pack("<BQ", _TIME, time_ns)


def parse(text: str) -> tuple[str, list[Any]]:
    """Reads a client's message: its op and the entries of its list, to be looked at one by one.

    Raises ValueError saying what is wrong with it.
    """
    if len(text.encode(errors="replace")) > MOST_BYTES:
        raise ValueError(f"a message is longer than {MOST_BYTES} bytes")
    try:
        body = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError("a message is not JSON that can be read") from None
    if not isinstance(body, dict):
        raise ValueError("a message is not a JSON object")
    op = body.get("op")
    lists = {"subscribe": "subscriptions", "unsubscribe": "subscriptionIds"}
    if not isinstance(op, str) or op not in lists:
        raise ValueError(f"op {op!r:.60} is not offered here; subscribe and unsubscribe are")
    entries = body.get(lists[op])
    if not isinstance(entries, list):
        raise ValueError(f"{op} needs '{lists[op]}', a list")
    return op, entries


def subscription(entry: Any) -> tuple[int, int]:
    """Reads (id, channel id) of an entry of subscribe. Raises ValueError."""
    if not isinstance(entry, dict):
        raise ValueError("a subscription is not an object with 'id' and 'channelId'")
    return number(entry.get("id"), "id"), number(entry.get("channelId"), "channelId")


def number(value: Any, what: str) -> int:
    """Reads an id. Raises ValueError unless it is a whole number from 0 to LARGEST_ID."""
    if type(value) is not int or not 0 <= value <= LARGEST_ID:
        raise ValueError(f"{what} {value!r:.40} is not a whole number from 0 to {LARGEST_ID}")
    return value
