"""Defines the message by which every node reports its state."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from msgs.header import Header, Message


@dataclass
class Diagnostics(Message):
    """Carries the state of one node, about once a second, and at once for warnings and errors.

    values: plain numbers by name: rate_hz, lag_ms, queue, drops, ms_per_update, rss_mb, and the node's own counters.
    """

    header: Header
    node: str = ""
    level: str = "ok"
    """`ok`, `warning` or `error`."""
    text: str = ""
    values: dict[str, Any] = field(default_factory=dict)
