"""Packs and unpacks the `mono` event encoding of event_camera_codecs: 8 bytes an event, exact to the nanosecond.

One uint64 each: polarity in bit 63, y in bits 48-62, x in bits 32-47, nanoseconds since the packet's time base in
bits 0-31.
"""

from __future__ import annotations

import numpy as np

SPAN_NS = 1 << 32
"""Times of one packet must lie within this many ns of its time base."""
MAX_Y = 0x7FFF
_BLOCK = 1 << 18
"""Events that are packed at a time: few steps, for each is a turn of the interpreter that threads wait for."""


def pack(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, base_ns: int) -> np.ndarray:
    """Packs events as uint64 [n]. t int64 [ns] in [base, base + 2^32); y is cut to 15 bits, p to its lowest."""
    words = np.empty(len(t), "<u8")
    pack_into(words, t, x, y, p, base_ns)
    return words


def pack_into(words: np.ndarray, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, base_ns: int) -> None:
    """Packs events as `pack` does into an array that is there, uint64 [n] contiguous and little endian."""
    ticks, high = words.view("<i8"), words.view("<u2").reshape(-1, 4)
    top = words.view(np.uint8).reshape(-1, 8)[:, 7]
    for first in range(0, len(t), _BLOCK):  # what is between two steps stays in the cache
        at = slice(first, first + _BLOCK)
        np.subtract(t[at], np.int64(base_ns), out=ticks[at])
        high[at, 2] = x[at]
        np.bitwise_and(y[at], np.uint16(MAX_Y), out=high[at, 3])
        top[at] |= p[at] << np.uint8(7)


def times(words: np.ndarray, base_ns: int) -> np.ndarray:
    """Returns the times int64 [ns] of uint64 words, also of `trigger`."""
    return (words & np.uint64(0xFFFFFFFF)).astype(np.int64) + np.int64(base_ns)


def unpack(words: np.ndarray, base_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Unpacks uint64 [n] to (t int64 [ns], x uint16, y uint16, p uint8)."""
    t = times(words, base_ns)
    x = ((words >> np.uint64(32)) & np.uint64(0xFFFF)).astype(np.uint16)
    y = ((words >> np.uint64(48)) & np.uint64(MAX_Y)).astype(np.uint16)
    return t, x, y, (words >> np.uint64(63)).astype(np.uint8)


def split(t: np.ndarray, t0_ns: int, ends: tuple[int, int] | None = None) -> list[tuple[int, int, int]]:
    """Yields runs (first, end, base [ns]) of consecutive events whose times fit one packet each.

    ends: the earliest and the latest time, where they are known. The base is `t0_ns` where that serves the whole
    packet, otherwise the earliest time of the run. A packet with no events is one empty run.
    """
    if not len(t):
        return [(0, 0, max(t0_ns, 0))]
    earliest, latest = ends or (int(t.min()), int(t.max()))
    if 0 <= t0_ns <= earliest and latest - t0_ns < SPAN_NS:
        return [(0, len(t), t0_ns)]
    runs = []
    first = 0
    while first < len(t):
        low, high = np.minimum.accumulate(t[first:]), np.maximum.accumulate(t[first:])
        end = first + int(np.searchsorted(high - low, SPAN_NS))  # the spread only ever grows
        runs.append((first, end, int(low[end - first - 1])))
        first = end
    return runs
