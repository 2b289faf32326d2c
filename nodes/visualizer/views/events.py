"""Event view: packets since a client's last bundle, as one 32-bit word per event that can be seen."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np

from msgs.camera import EventPacket
from msgs.header import Message
from nodes.visualizer.views.part import Part, View, header_meta

MAX_EVENTS = 100_000
"""Most events drawn of one packet and sent in one bundle; the page states how many it does not draw."""
MOST_LOOKED_AT = 2_000_000
"""A packet with more events is thinned before the newest of each pixel is looked for."""
DENSE = 10_000
"""Packets with more events are reduced to the newest event of each pixel: the others would be painted over."""
_MAP = 1 << 24
"""Pixels up to which the newest events are found with a map of all of them."""
MAX_PACKETS = 64
"""Packets held for a client that is behind; older ones are not drawn, but counted."""
MAX_TOTALS = 4096
"""Packets that a client may be behind before counts start at the oldest one remembered."""
MAX_COORDINATE = 1 << 14


class _Totals(NamedTuple):
    """Sums over an episode, so that what lies between two versions is a difference."""

    events: int = 0
    on: int = 0
    span_ns: int = 0
    lost: int = 0
    covered: int = 0


def pack(x: np.ndarray, y: np.ndarray, p: np.ndarray, c: np.ndarray | None = None) -> np.ndarray:
    """uint32 [n] words: x in bits 0-13, y in bits 14-27, colour + 1 in bits 28-29 (0 = none), polarity in bit 31."""
    words = x.astype(np.uint32) | (y.astype(np.uint32) << np.uint32(14)) | (p.astype(np.uint32) << np.uint32(31))
    if c is not None:
        words |= (np.minimum(c, 2).astype(np.uint32) + np.uint32(1)) << np.uint32(28)
    return words


def newest_of_pixels(x: np.ndarray, y: np.ndarray, width: int, height: int) -> np.ndarray:
    """Indices of the last event of each pixel; all coordinates lie within width and height."""
    if width * height > _MAP:
        # a header can state any size: by sorting, memory is that of the events
        place = y[::-1].astype(np.int64) * width + x[::-1]
        return len(x) - 1 - np.unique(place, return_index=True)[1]
    last = np.full(width * height, -1, np.int32)
    last[y.astype(np.int32) * width + x] = np.arange(len(x), dtype=np.int32)  # numpy keeps the last one assigned
    return last[last >= 0]


def thin(n: int, most: int) -> slice:
    """Every k-th of n, so that at most `most` are left and all parts of the interval stay visible."""
    return slice(None, None, max(1, -(-n // most)))


def _select(
    which: Any, x: np.ndarray, y: np.ndarray, p: np.ndarray, c: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    return x[which], y[which], p[which], None if c is None else c[which]


class EventView(View):
    """Events of one environment. Accumulates what a slow client has not seen yet, up to MAX_PACKETS packets."""

    KIND = "events"

    def __init__(self, name: str, env: int) -> None:
        super().__init__(name, env)
        self._packets: deque[tuple[int, np.ndarray]] = deque(maxlen=MAX_PACKETS)
        self._before: deque[tuple[int, _Totals]] = deque(maxlen=MAX_TOTALS)
        self._totals = _Totals()
        self._last: dict[str, Any] = {}
        self._episode = -1

    def capture(self, message: Message) -> None:
        assert isinstance(message, EventPacket)
        meta = {**header_meta(message.header), "width": message.width, "height": message.height}
        if message.x is None or message.y is None or message.p is None:
            words, events, on, covered = np.empty(0, np.uint32), 0, 0, 0
            meta["note"] = f"packets hold {message.encoding or 'raw'} bytes that are not decoded in this graph"
        else:
            words, events, on, covered, outside = self._words(message)
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
            self._packets.append((self.version, words))
            self._last = meta

    def _words(self, message: EventPacket) -> tuple[np.ndarray, int, int, int, int]:
        """Words to draw; counts of events, of ON events, of covered ones and of ones outside the sensor."""
        x, y, p, c = (None if a is None else np.asarray(a) for a in (message.x, message.y, message.p, message.c))
        assert x is not None and y is not None and p is not None
        offsets = np.asarray(message.env_offsets)
        if len(offsets) > 1:
            env = min(self.env, len(offsets) - 2)
            part = slice(int(offsets[env]), int(offsets[env + 1]))
            x, y, p, c = _select(part, x, y, p, c)
        events, on = len(x), int(np.count_nonzero(p))
        width, height = (min(size or MAX_COORDINATE, MAX_COORDINATE) for size in (message.width, message.height))
        seen = thin(events, MOST_LOOKED_AT)
        x, y, p, c = _select(seen, x, y, p, c)
        inside = (x < width) & (y < height)
        outside = len(x) - int(np.count_nonzero(inside))
        if outside:
            x, y, p, c = _select(inside, x, y, p, c)
        covered = 0
        if len(x) > DENSE:
            newest = newest_of_pixels(x, y, width, height)
            covered = len(x) - len(newest)
            x, y, p, c = _select(newest, x, y, p, c)
        x, y, p, c = _select(thin(len(x), MAX_EVENTS), x, y, p, c)
        return pack(x, y, p != 0, c), events, on, covered, outside

    def render(self, since: int) -> Part | None:
        with self._lock:
            version, meta = self.version, dict(self._last)
            if version <= since:
                return None
            # A client that has nothing yet gets the newest packet alone: it has missed nothing that it had asked for.
            first = max(since + 1 if since else version, self._before[0][0])
            packets = [words for v, words in self._packets if v >= first]
            before = self._before[first - self._before[0][0]][1]
            events, on, span_ns, lost, covered = (a - b for a, b in zip(self._totals, before))
        words = np.concatenate(packets)
        words = words[thin(len(words), MAX_EVENTS)]
        undrawn = events - covered - len(words)
        meta |= {"events": events, "on": on, "span": span_ns / 1e9, "undrawn": undrawn, "lost": lost}
        return Part(self.KIND, version, meta, words.astype("<u4").tobytes())
