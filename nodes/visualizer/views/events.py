"""Makes the event view: packets since a client's last bundle, a 32-bit word and a 16-bit age per event that can be
seen."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np

from msgs.camera import EventPacket
from msgs.header import Message
from nodes.visualizer.views.part import PanelPart, TopicView, header_meta

MAX_EVENTS = 100_000
"""Most events drawn of one packet and sent in one bundle; the page states how many it does not draw."""
MOST_LOOKED_AT = 2_000_000
"""A packet with more events is thinned before the newest of each pixel is looked for."""
DENSE = 10_000
"""Packets with more events are reduced to the newest event of each pixel: the others would be painted over."""
MAX_PACKETS = 64
"""Packets held for a client that is behind; older ones are not drawn, but counted."""
MAX_TOTALS = 4096
"""Packets that a client may be behind before counts start at the oldest one remembered."""
MAX_COORDINATE = 1 << 14
MOST_PIXELS = 1 << 24
"""A sensor that says that it has more gets no table of its pixels: a recording can say what it likes."""
AGES = (1 << 16) - 1
"""The age on the wire of the oldest event of a part; the others are in proportion."""


class _Drawn(NamedTuple):
    """Holds what is drawn of one packet: words uint32 [n], and how long before the packet's stamp, float32 [n] s."""

    version: int
    stamp_ns: int
    words: np.ndarray
    ages: np.ndarray


class _Totals(NamedTuple):
    """Sums over an episode, so that what lies between two versions is a difference."""

    events: int = 0
    on: int = 0
    span_ns: int = 0
    lost: int = 0
    covered: int = 0


def pack(x: np.ndarray, y: np.ndarray, p: np.ndarray, c: np.ndarray | None = None) -> np.ndarray:
    """Packs events into uint32 [n]: x in bits 0-13, y in 14-27, colour + 1 in 28-29 (0 = none), polarity in 31."""
    words = x.astype(np.uint32) | (y.astype(np.uint32) << np.uint32(14)) | (p.astype(np.uint32) << np.uint32(31))
    if c is not None:
        words |= (np.minimum(c, 2).astype(np.uint32) + np.uint32(1)) << np.uint32(28)
    return words


def newest_of_pixels(x: np.ndarray, y: np.ndarray, width: int, height: int) -> np.ndarray:
    """Returns indices of the last event of each pixel; all coordinates lie within width and height."""
    if width * height > MOST_PIXELS:
        index = y.astype(np.int64) * width + x
        _, first = np.unique(index[::-1], return_index=True)
        return len(x) - 1 - first
    last = np.full(width * height, -1, np.int32)
    last[y.astype(np.int32) * width + x] = np.arange(len(x), dtype=np.int32)  # numpy keeps the last one assigned
    return last[last >= 0]


def thin(n: int, most: int) -> Any:
    """Picks at most `most` of n: evenly, and in no step of which a sensor's width could be a multiple."""
    if n <= most:
        return slice(None)
    # Multiples of the golden ratio, modulo 1: a step of equal size would draw some columns and never the others.
    place = np.arange(n, dtype=np.uint32) * np.uint32(2654435769)
    return np.flatnonzero(place < np.uint32((most << 32) // n))[:most]


def _select(which: Any, *columns: np.ndarray | None) -> list[Any]:
    return [None if column is None else column[which] for column in columns]


class EventView(TopicView):
    """Shows the events of one environment.

    Accumulates what a slow client has not seen yet, up to MAX_PACKETS packets.

    A part's payload is the words uint32 [n], then their ages uint16 [n] in AGES-ths of `oldest` [s] before its time.
    """

    KIND = "events"

    def __init__(self, name: str, env: int) -> None:
        super().__init__(name, env)
        self._packets: deque[_Drawn] = deque(maxlen=MAX_PACKETS)
        self._before: deque[tuple[int, _Totals]] = deque(maxlen=MAX_TOTALS)
        self._totals = _Totals()
        self._last: dict[str, Any] = {}
        self._episode = -1

    def capture(self, message: Message) -> None:
        assert isinstance(message, EventPacket)
        meta = {**header_meta(message.header), "width": message.width, "height": message.height}
        meta["colour"] = message.c is not None
        if message.x is None or message.y is None or message.p is None:
            words, ages, events, on, covered = np.empty(0, np.uint32), np.empty(0, np.float32), 0, 0, 0
            meta["note"] = f"packets hold {message.encoding or 'raw'} bytes that are not decoded in this graph"
        else:
            words, ages, events, on, covered, outside = self._words(message)
            if outside:
                meta["note"] = f"{outside} events outside the sensor"
        news = (events, on, max(message.header.stamp_ns - message.t0_ns, 0), message.lost, covered)
        with self._lock:
            if message.header.episode != self._episode:
                self._episode = message.header.episode
                self._packets.clear()
                self._before.clear()
            self.version += 1
            self._before.append((self.version, self._totals))
            self._totals = _Totals(*(a + b for a, b in zip(self._totals, news)))
            self._packets.append(_Drawn(self.version, message.header.stamp_ns, words, ages))
            self._last = meta

    def _words(self, message: EventPacket) -> tuple[np.ndarray, np.ndarray, int, int, int, int]:
        """Returns words to draw and their ages; counts of events, ON events, covered ones and ones outside."""
        x, y, p, c, t = (
            None if a is None else np.asarray(a) for a in (message.x, message.y, message.p, message.c, message.t)
        )
        assert x is not None and y is not None and p is not None
        offsets = np.asarray(message.env_offsets)
        if len(offsets) > 1:
            env = min(self.env, len(offsets) - 2)
            part = slice(int(offsets[env]), int(offsets[env + 1]))
            x, y, p, c, t = _select(part, x, y, p, c, t)
        events, on = len(x), int(np.count_nonzero(p))
        width, height = (min(size or MAX_COORDINATE, MAX_COORDINATE) for size in (message.width, message.height))
        seen = thin(events, MOST_LOOKED_AT)
        x, y, p, c, t = _select(seen, x, y, p, c, t)
        inside = (x < width) & (y < height)
        outside = len(x) - int(np.count_nonzero(inside))
        if outside:
            x, y, p, c, t = _select(inside, x, y, p, c, t)
        covered = 0
        if len(x) > DENSE:
            newest = newest_of_pixels(x, y, width, height)
            covered = len(x) - len(newest)
            x, y, p, c, t = _select(newest, x, y, p, c, t)
        x, y, p, c, t = _select(thin(len(x), MAX_EVENTS), x, y, p, c, t)
        if t is None:
            t = np.full(len(x), message.header.stamp_ns, np.int64)
        ages = (np.maximum(message.header.stamp_ns - t, 0) / 1e9).astype(np.float32)
        return pack(x, y, p != 0, c), ages, events, on, covered, outside

    def render(self, since: int) -> PanelPart | None:
        with self._lock:
            version, meta = self.version, dict(self._last)
            if version <= since:
                return None
            # A client that has nothing yet gets the newest packet alone: it has missed nothing that it had asked for.
            first = max(since + 1 if since else version, self._before[0][0])
            packets = [packet for packet in self._packets if packet.version >= first]
            before = self._before[first - self._before[0][0]][1]
            events, on, span_ns, lost, covered = (a - b for a, b in zip(self._totals, before))
        words = np.concatenate([packet.words for packet in packets])
        end_ns = packets[-1].stamp_ns
        ages = np.concatenate([packet.ages + np.float32((end_ns - packet.stamp_ns) / 1e9) for packet in packets])
        words, ages = _select(thin(len(words), MAX_EVENTS), words, ages)
        undrawn = events - covered - len(words)
        oldest = float(ages.max(initial=0))
        meta |= {"events": events, "on": on, "span": span_ns / 1e9, "undrawn": undrawn, "lost": lost, "oldest": oldest}
        steps = np.round(ages * (AGES / oldest)) if oldest else ages
        payload = words.astype("<u4").tobytes() + np.clip(steps, 0, AGES).astype("<u2").tobytes()
        return PanelPart(self.KIND, version, meta, payload)
