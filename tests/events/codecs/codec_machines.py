"""Decoders one word at a time in plain Python, written against the description of the words and nothing else.

Each gives (events (t_us, x, y, p), triggers (t_us, id, value), counts).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

Row = tuple[int, int, int, int]
Result = tuple[list[Row], list[tuple[int, int, int]], Counter]
TRIGGERS = {2: (0, 0), 3: (0, 1), 4: (2, 1), 16: (1, 0), 17: (1, 1)}


class Machine:
    """Where events go: inside the sensor, or counted."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.events: list[Row] = []
        self.triggers: list[tuple[int, int, int]] = []
        self.counts: Counter = Counter()

    def emit(self, t: int, x: int, y: int, p: int) -> None:
        if 0 <= y < self.height and 0 <= x < self.width:
            self.events.append((t, x, y, p))
        else:
            self.counts["outside"] += 1

    def result(self) -> Result:
        return self.events, self.triggers, self.counts


def run_evt21(words: Iterable[int], width: int, height: int) -> Result:
    m = Machine(width, height)
    high: int | None = None
    loop = 0
    for word in words:
        kind = word >> 60
        if kind == 8:
            value = word >> 32 & 0xFFFFFFF
            loop += high is not None and high >= value + 2**27
            high = value
        elif high is None:
            m.counts["untimed"] += 1
        elif kind in (0, 1):
            t = loop * 2**34 + high * 64 + (word >> 54 & 63)
            for i in range(32):
                if word >> i & 1:
                    m.emit(t, (word >> 43 & 0x7FF) + i, word >> 32 & 0x7FF, kind)
        elif kind == 10:
            m.triggers.append((loop * 2**34 + high * 64 + (word >> 54 & 63), word >> 40 & 31, word >> 32 & 1))
        elif kind not in (14, 15):
            m.counts["unknown"] += 1
    return m.result()


def run_evt4(words: Iterable[int], width: int, height: int) -> Result:
    m = Machine(width, height)
    high: int | None = None
    loop = 0
    vector: int | None = None
    for word in words:
        if vector is not None:
            if high is not None:
                t = loop * 2**34 + high * 64 + (vector >> 22 & 63)
                for i in range(32):
                    if word >> i & 1:
                        m.emit(t, (vector >> 11 & 0x7FF) + i, vector & 0x7FF, vector >> 28 & 1)
            vector = None
            continue
        kind = word >> 28
        vector = word if kind in (0xC, 0xD) else None
        if kind == 0xE:
            value = word & 0xFFFFFFF
            loop += high is not None and high >= value + 2**27
            high = value
        elif high is None:
            m.counts["untimed"] += 1
        elif kind in (0xA, 0xB):
            m.emit(loop * 2**34 + high * 64 + (word >> 22 & 63), word >> 11 & 0x7FF, word & 0x7FF, kind & 1)
        elif kind == 9:
            m.triggers.append((loop * 2**34 + high * 64 + (word >> 22 & 63), word >> 8 & 31, word & 1))
        elif kind not in (6, 7, 0xC, 0xD, 0xF):
            m.counts["unknown"] += 1
    return m.result()


def _inivation(words: Iterable[int], m: Machine, event) -> Result:
    """The frame that DAVIS and DVXplorer share; `event(code, data, t)` says whether the code was its own."""
    timed, offset, now = False, 0, 0
    for word in words:
        code, data = word >> 12, word & 0xFFF
        if not timed and not (code >= 7 or word == 1):
            m.counts["untimed"] += 1
            continue
        timed = True
        if word & 0x8000:
            now = offset + (word & 0x7FFF)
        elif code == 7:
            offset += 0x8000 * data
            now = offset
        elif word == 1:
            offset = now = 0
            m.counts["timestamp_resets"] += 1
        elif code == 0 and data in TRIGGERS:
            m.triggers.append((now, *TRIGGERS[data]))
        elif not event(code, data, now):
            m.counts["unknown"] += 1
    return m.result()


def run_davis346(words: Iterable[int], width: int, height: int) -> Result:
    m, at = Machine(width, height), {"row": 0}

    def event(code: int, data: int, t: int) -> bool:
        if code == 1:
            at["row"] = data
        elif code in (2, 3):
            m.emit(t, data, at["row"], code - 2)
        else:
            specials = (5, 7, 8, 9, 10, 11, 12, 13, 14, 15)
            return code in (4, 6) or (code == 5 and data >> 8 < 4) or (code == 0 and data in specials)
        return True

    return _inivation(words, m, event)


def run_dvxplorer(words: Iterable[int], width: int, height: int) -> Result:
    m, at = Machine(width, height), {"x": 0, "first": 0, "second": 0}

    def event(code: int, data: int, t: int) -> bool:
        if code == 1:
            at["x"] = data & 0x3FF
        elif code == 4:
            step = data >> 6 & 31
            at["first"] = (data & 63) * 8
            at["second"] = at["first"] + 8 * (-step if data & 0x800 else step)
        elif code in (2, 3):
            for i in range(8):
                if data >> i & 1:
                    m.emit(t, at["x"], at["first" if code == 3 else "second"] + i, 0 if data & 0x100 else 1)
        else:
            return (code == 5 and data >> 8 in (0, 3)) or (code == 0 and data in (5, 7))
        return True

    return _inivation(words, m, event)


def run_dvxplorer_mini(words: Iterable[int], width: int, height: int) -> Result:
    m = Machine(width, height)
    reference = used = last = x = None
    turns = now = sub = 0
    for word in words:
        if word >> 31:
            if x is None:
                m.counts["untimed"] += 1
                continue
            first = word >> 18 & 63
            for group, shift, sign in ((first, 0, 16), (first + (word >> 26 & 31), 8, 17)):
                for i in range(8):
                    if word >> shift + i & 1:
                        m.emit(now, x, group * 8 + i, 1 - (word >> sign & 1))
        elif word >> 26 & 1:
            column, lost = word & 0x3FF, ""
            if reference is None or (not word >> 21 & 1 and x is None):
                m.counts["untimed"] += 1
            elif word >> 21 & 1:
                if used == reference and (word >> 11 & 0x3FF) <= sub:
                    lost = "lost_references"
                else:
                    used, sub, x = reference, word >> 11 & 0x3FF, column
                    now = reference * 1000 + sub
            elif column <= x:
                lost = "lost_columns"
            else:
                x = column
            if lost:
                m.counts[lost] += 1
                reference = used = x = None
        elif word >> 27 & 1:
            value = word & 0x3FFFFF
            turns += last is not None and value < last
            last, reference = value, turns * 2**22 + value
        elif word:
            m.counts["unknown"] += 1
    return m.result()


def run_dvs128(words: Iterable[int], width: int, height: int) -> Result:
    m, base = Machine(width, height), 0
    for word in words:
        if word >> 31:
            base += 0x4000
        elif word >> 30 & 1:
            base = 0
            m.counts["timestamp_resets"] += 1
        elif word >> 15 & 1:
            m.triggers.append((base + (word >> 16), 0, 1))
        else:
            m.emit(base + (word >> 16), 127 - (word >> 1 & 127), 127 - (word >> 8 & 127), 1 - (word & 1))
    return m.result()


def run_libcaer_cmp(words: Iterable[int], width: int, height: int) -> Result:
    m = Machine(width, height)
    high = low = x = base = sign = 0
    for word in words:
        code, data = word >> 12, word & 0xFFF
        t = high << 12 | low
        if code == 0:
            high = data
        elif code == 1:
            low = data
        elif code == 2:
            x = data & 0x7FF
        elif code == 3:
            m.emit(t, x, data & 0x7FF, data >> 11)
        elif code == 4:
            base, sign = data & 0x7FF, data >> 11
        elif code == 5:
            for i in range(8):
                if data >> i & 1:
                    m.emit(t, x, (base + i) % 65536, sign)
            base += 8
        else:
            m.counts["unknown"] += 1
    return m.result()


MACHINES = {
    "evt21": run_evt21,
    "evt4": run_evt4,
    "davis346": run_davis346,
    "dvxplorer": run_dvxplorer,
    "dvxplorer_mini": run_dvxplorer_mini,
    "dvs128": run_dvs128,
    "libcaer_cmp": run_libcaer_cmp,
}
