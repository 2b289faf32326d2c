"""Decoders one word at a time in plain Python: slow, and near enough to the rules to be read against them."""

from __future__ import annotations

from collections.abc import Iterable

Row = tuple[int, int, int, int]


def run_evt3(words: Iterable[int], width: int, height: int) -> tuple[list[Row], list[tuple[int, int, int]], int, int]:
    """(events (t_us, x, y, p), triggers (t_us, id, value), events outside, words before the first TIME_HIGH)."""
    events: list[Row] = []
    triggers = []
    outside = untimed = loop = low = y = base = polarity = 0
    high: int | None = None

    def emit(x: int, p: int) -> None:
        nonlocal outside
        assert high is not None
        if (height and y >= height) or (width and x >= width):
            outside += 1
        else:
            events.append((loop * 2**24 + high * 2**12 + low, x, y, p))

    for word in words:
        kind, value = word >> 12, word & 0xFFF
        if high is None and kind != 8:
            untimed += 1
        elif kind == 0:
            y = value & 0x7FF
        elif kind == 2:
            emit(value & 0x7FF, value >> 11)
        elif kind == 3:
            base, polarity = value & 0x7FF, value >> 11
        elif kind in (4, 5):
            size = 12 if kind == 4 else 8
            for i in range(size):
                if value >> i & 1:
                    emit((base + i) % 65536, polarity)
            base += size
        elif kind == 6:
            low = value
        elif kind == 8:
            if high is not None and high >= value + 2048:
                loop += 1
            if high != value:
                low = 0
            high = value
        elif kind == 10:
            assert high is not None
            triggers.append((loop * 2**24 + high * 2**12 + low, value >> 8 & 15, value & 1))
    return events, triggers, outside, untimed


def run_evt2(words: Iterable[int], width: int, height: int) -> tuple[list[Row], list[tuple[int, int, int]], int, int]:
    """As run_evt3."""
    events: list[Row] = []
    triggers = []
    outside = untimed = loop = 0
    high: int | None = None
    for word in words:
        kind = word >> 28
        if kind == 8:
            value = word & 0xFFFFFFF
            if high is not None and high >= value + 2**27:
                loop += 1
            high = value
            continue
        if high is None:
            untimed += 1
            continue
        t = loop * 2**34 + high * 64 + (word >> 22 & 63)
        x, y = word >> 11 & 0x7FF, word & 0x7FF
        if kind in (0, 1):
            if (height and y >= height) or (width and x >= width):
                outside += 1
            else:
                events.append((t, x, y, kind))
        elif kind == 10:
            triggers.append((t, word >> 8 & 31, word & 1))
    return events, triggers, outside, untimed
