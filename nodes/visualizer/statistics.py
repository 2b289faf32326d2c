"""Measures rates of the graph from what nodes say on /diagnostics and from what the taps themselves saw."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from msgs.camera import EventPacket
from msgs.diagnostics import Diagnostics
from msgs.header import Message, missed_between
from msgs.world import Clock

WINDOW_S = 2.0
"""Rates are means over this time."""
STALE_S = 3.0
"""A node that has said nothing for longer is shown as silent."""
MAX_WARNINGS = 50


def plain(value: Any) -> Any:
    """Returns `value` as strict JSON: numbers that are not finite become text, numpy scalars plain numbers."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if hasattr(value, "item") and not isinstance(value, (str, bytes)):
        value = value.item()
    if isinstance(value, float) and not -1e300 < value < 1e300:
        return str(value)
    return value if isinstance(value, (int, float, str, bool, type(None))) else str(value)


@dataclass
class Meter:
    """Measures the rate of a growing count over WINDOW_S."""

    samples: deque[tuple[float, float]] = field(default_factory=deque)

    def add(self, now: float, total: float) -> None:
        """Takes the count, `total` at `now` [s]. A count that fell (a node came back) starts afresh."""
        if self.samples and total < self.samples[-1][1]:
            self.samples.clear()
        self.samples.append((now, total))
        while len(self.samples) > 2 and now - self.samples[1][0] >= WINDOW_S:
            self.samples.popleft()

    def rate(self) -> float:
        """Returns counts per second; 0 until two samples are there, and when nothing has come for STALE_S."""
        if len(self.samples) < 2 or time.monotonic() - self.samples[-1][0] > STALE_S:
            return 0.0
        (t0, n0), (t1, n1) = self.samples[0], self.samples[-1]
        return (n1 - n0) / (t1 - t0) if t1 > t0 else 0.0


@dataclass
class _Tapped:
    messages: int = 0
    skipped: int = 0
    seq: int = -1
    episode: int = -1
    stamp_ns: int = 0
    events: Meter = field(default_factory=Meter)
    total_events: int = 0
    rate: Meter = field(default_factory=Meter)


@dataclass
class _NodeState:
    heard: float
    level: str
    text: str
    values: dict[str, Any]
    updates: Meter = field(default_factory=Meter)
    events: Meter = field(default_factory=Meter)
    busy: Meter = field(default_factory=Meter)
    waits: Meter = field(default_factory=Meter)


class Statistics:
    """Counts messages on the executor's thread, for the server's thread to read.

    All methods are safe from any thread.
    """

    def __init__(self, latched: Collection[str] = ()) -> None:
        """Begins with nothing heard. latched: topics whose messages say again what is so, which is no sign that the
        graph goes on."""
        self._latched = latched
        self._lock = threading.Lock()
        self._tapped: dict[str, _Tapped] = {}
        self._nodes: dict[str, _NodeState] = {}
        self._published: dict[str, Meter] = {}
        self._paces: dict[str, Meter] = {}
        """Stamps [s] by clock: those of two cameras are apart by anything."""
        self._news_at: float | None = None
        self._warnings: deque[dict[str, str]] = deque(maxlen=MAX_WARNINGS)

    def saw(self, topic: str, message: Message) -> None:
        """Counts one message of a tap."""
        now = time.monotonic()
        with self._lock:
            if isinstance(message, Clock):
                # A device's time does not start at 0: the factor is that of the last moments, not stamp / wall.
                self._paces.setdefault(message.header.clock, Meter()).add(now, message.header.stamp_ns / 1e9)
                self._news_at = now
            elif isinstance(message, Diagnostics):
                self._diagnose(now, message)
            else:
                self._count(now, topic, message)

    def _count(self, now: float, topic: str, message: Message) -> None:
        tapped = self._tapped.setdefault(topic, _Tapped())
        header = message.header
        if tapped.seq >= 0:
            tapped.skipped += missed_between(tapped.seq, header.seq)
        tapped.seq, tapped.episode, tapped.stamp_ns = header.seq, header.episode, header.stamp_ns
        tapped.messages += 1
        if topic not in self._latched:
            self._news_at = now
        tapped.rate.add(now, tapped.messages)
        if isinstance(message, EventPacket):
            tapped.total_events += 0 if message.x is None else len(message.x)
            tapped.events.add(now, tapped.total_events)

    def _diagnose(self, now: float, message: Diagnostics) -> None:
        values = message.values
        node = self._nodes.setdefault(message.node, _NodeState(now, "ok", "", {}))
        node.heard, node.values = now, values
        if message.level in ("warning", "error"):
            node.level, node.text = message.level, message.text
            self._warnings.appendleft({"node": message.node, "level": message.level, "text": message.text})
        for meter, key in (
            (node.updates, "updates"),
            (node.events, "events"),
            (node.busy, "busy_s"),
            (node.waits, "waits_s"),
        ):
            if isinstance(values.get(key), (int, float)):
                meter.add(now, values[key])
        published = values.get("published")
        for topic, total in published.items() if isinstance(published, dict) else ():
            if isinstance(total, (int, float)):
                meter = self._published.setdefault(topic, Meter())
                if topic not in self._latched and total > (meter.samples[-1][1] if meter.samples else 0):
                    self._news_at = now
                meter.add(now, total)

    def forget(self, topic: str) -> None:
        """Notes that a tap was closed: the messages until it is opened again were not missed."""
        with self._lock:
            if topic in self._tapped:
                self._tapped[topic].seq = -1
                self._tapped[topic].rate = Meter()
                self._tapped[topic].events = Meter()
            if topic == "/diagnostics":
                self._news_at = None  # nobody looks any more: what follows will not have been a silence

    def snapshot(self) -> dict[str, Any]:
        """Returns what the page's status line and Rates panel show."""
        now = time.monotonic()
        with self._lock:
            topics = {name: {"hz": round(m.rate(), 2)} for name, m in self._published.items()}
            for name, tapped in self._tapped.items():
                entry = topics.setdefault(name, {"hz": round(tapped.rate.rate(), 2)})
                entry |= {"shown_hz": round(tapped.rate.rate(), 2), "skipped": tapped.skipped}
                if tapped.total_events:
                    entry["events_per_s"] = round(tapped.events.rate())
            nodes = {name: self._node(now, state) for name, state in self._nodes.items()}
            events = sum(m.events.rate() for m in self._nodes.values())
            clock = self._clock(now)
            heard = [(t.episode, t.stamp_ns) for t in self._tapped.values() if t.seq >= 0]
            if not clock and heard:
                # A topic that is closed, or rare, may have stopped in an earlier round of a recording.
                clock = {"t": max(heard)[1] / 1e9}
            return plain(
                {
                    "clock": clock,
                    "quiet_s": None if self._news_at is None else round(now - self._news_at, 1),
                    "topics": topics,
                    "nodes": nodes,
                    "events_per_s": round(events or sum(t.events.rate() for t in self._tapped.values())),
                    "drops": sum(n["drops"] for n in nodes.values()),
                    "warnings": list(self._warnings),
                }
            )

    def _clock(self, now: float) -> dict[str, Any]:
        """Returns time and real-time factor of the clock that was heard first, of those that go on where there are
        such; nothing before any was heard."""
        going = [c for c, pace in self._paces.items() if now - pace.samples[-1][0] <= STALE_S] or list(self._paces)
        if not going:
            return {}
        pace = self._paces[going[0]]
        clock = {"t": pace.samples[-1][1], "clock": going[0]}
        # Of one stamp, as a round of a recording begins with, there is no rate.
        return clock | ({"rtf": round(pace.rate(), 3)} if len(pace.samples) > 1 else {})

    @staticmethod
    def _node(now: float, state: _NodeState) -> dict[str, Any]:
        counters = state.values.get("counters")
        counters = counters if isinstance(counters, dict) else {}
        silent = now - state.heard > STALE_S
        return {
            "level": "silent" if silent else state.level,
            "text": state.text,
            "hz": round(state.updates.rate(), 2),
            "ms": state.values.get("ms_per_update", 0),
            "busy": round(state.busy.rate(), 3),
            "waits": round(state.waits.rate(), 3),
            "queue": state.values.get("queue", 0),
            "lag_ms": state.values.get("lag_ms"),
            "drops": sum(v for k, v in counters.items() if k in ("lost", "drops", "dropped", "skipped_inputs")),
            "counters": counters,
        }
