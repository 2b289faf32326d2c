"""Decodes and encodes DVXplorer Mini over USB (MIPI bridge): 32-bit words, 0 = padding.

Bit 31: two groups of eight rows (first group bits 18-23, the second 26-30 further on; masks in bits 0-7 and 8-15,
polarities in bits 16 and 17, 0 = ON) in the column in force. Bit 26: a column (bits 0-9); with bit 21 a readout starts,
its time being the last reference plus bits 11-20 in us. Bit 27: the reference, ms in 22 bits. A sub-time that does not
rise within one reference, or a column that does not rise within a readout, means that words were lost: nothing counts
then until the next reference and the next start of a readout.
"""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs import decoder
from evis.events.codecs.encoder import REBASE, find_groups
from evis.events.codecs.encoder import Encoder as _Encoder
from evis.events.codecs.inivation.dvxplorer import folded

GROUPS, REFERENCE, COLUMN = 1 << 31, 1 << 27, 1 << 26
# the fields of a column and of two groups
START_SHIFT, SUB_SHIFT, COLUMN_MASK, SUB_MASK = 21, 11, 0x3FF, 0x3FF
FIRST_SHIFT, FIRST_MASK, STEP_SHIFT, STEP_MASK, SIGN_SHIFT, ROWS = 18, 63, 26, 31, 16, 8
REFERENCE_BITS = 22
REFERENCE_MASK = (1 << REFERENCE_BITS) - 1
MAX_TURNS = 100_000
"""Turns of the reference (13 years) beyond which times do not count from the device's start, in either direction."""

# places in the state vector, shared with the kernel; TIMED is 1 once a reference has come, -1 after a loss
(
    TIMED, BASE, TURNS, LAST, X, NOW, USED, SUB, OUTSIDE, UNTIMED, UNKNOWN, LOST_TIME, LOST_COLUMN, BINNED
) = range(14)  # fmt: skip


class Decoder(decoder.Decoder):
    """Decodes DVXplorer Mini words to events. binned: see `evis.events.codecs.inivation.dvxplorer.Decoder`."""

    encoding = "dvxplorer_mini"
    word = np.dtype("<u4")
    wrap_ns = 1_000_000 << REFERENCE_BITS
    state_size = 14
    counters = {
        "outside": OUTSIDE,
        "untimed": UNTIMED,
        "unknown": UNKNOWN,
        "lost_references": LOST_TIME,
        "lost_columns": LOST_COLUMN,
    }
    geometry = (640, 480)
    kernel = "evis.events.codecs.inivation.dvxplorer_mini_kernels:decode_dvxplorer_mini"

    binned = False

    def _reset_context(self) -> None:
        self.state[[X, USED, SUB]] = -1
        self.state[BINNED] = self.binned

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes words by numpy, the twin of the kernel: columns and references one by one in Python, groups
        vectorised.
        """
        is_group = words >= GROUPS
        places = np.flatnonzero(~is_group & (words != 0))
        before = self.state.copy()
        x, now = self._track_columns(words[places].tolist())
        groups = np.flatnonzero(is_group)
        of = decoder.count_until(~is_group & (words != 0), groups)
        valid = x[of] >= 0
        late = valid & (now[of] > limit)
        following, cut = -1, len(words)
        if late.any():
            i = int(np.argmax(late))
            following, cut = int(now[of[i]]), int(groups[i])
            self.state = before
            x, now = self._track_columns(words[places[places < cut]].tolist())
            groups, of, valid = groups[:i], of[:i], valid[:i]
        self.state[UNTIMED] += np.count_nonzero(~valid)
        return self._events(words[groups[valid]], x[of[valid]], now[of[valid]]), cut, following

    def _track_columns(self, words: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """Computes column (-1: none yet) and time [us] before the first word and after each. Updates the state."""
        s = self.state.tolist()
        columns, times = [s[X]], [s[NOW]]
        for word in words:
            if word & COLUMN:
                column = word & COLUMN_MASK
                if s[TIMED] <= 0 or (not word >> START_SHIFT & 1 and s[X] < 0):
                    s[UNTIMED] += 1
                elif word >> START_SHIFT & 1:
                    sub = word >> SUB_SHIFT & SUB_MASK
                    if s[BASE] == s[USED] and sub <= s[SUB]:
                        s[LOST_TIME] += 1
                        s[TIMED] = s[X] = s[USED] = s[SUB] = -1
                    else:
                        s[X], s[USED], s[SUB], s[NOW] = column, s[BASE], sub, s[BASE] * 1000 + sub
                elif column <= s[X]:
                    s[LOST_COLUMN] += 1
                    s[TIMED] = s[X] = s[USED] = s[SUB] = -1
                else:
                    s[X] = column
            elif word & REFERENCE:
                value = word & REFERENCE_MASK
                if value < s[LAST] and s[TURNS] < MAX_TURNS:
                    s[TURNS] += 1
                s[TIMED], s[LAST], s[BASE] = 1, value, (s[TURNS] << REFERENCE_BITS) + value
            else:
                s[UNKNOWN] += 1
            columns.append(s[X])
            times.append(s[NOW])
        self.state = np.array(s, np.int64)
        return np.array(columns, np.int64), np.array(times, np.int64)

    def _events(self, words: np.ndarray, x: np.ndarray, now: np.ndarray) -> Events:
        bits = np.unpackbits((words & 0xFFFF).astype("<u2").view(np.uint8), bitorder="little")
        flat = np.flatnonzero(bits.view(bool))
        of, second = flat >> 4, flat >> 3 & 1
        word = words[of].astype(np.int64)
        columns, rows = self.readout
        x, row = (
            x[of],
            ((word >> FIRST_SHIFT & FIRST_MASK) + np.where(second, word >> STEP_SHIFT & STEP_MASK, 0)) * ROWS,
        )
        if self.state[BINNED]:
            x, row = folded(x, columns), folded(row, rows)
        y = row + (flat & 7)
        p = (1 - (word >> SIGN_SHIFT + second & 1)).astype(np.uint8)
        keep = (y < rows) & (x < columns)
        if not keep.all():
            self.state[OUTSIDE] += np.count_nonzero(~keep)
            of, x, y, p = of[keep], x[keep], y[keep], p[keep]
        return Events(now[of] * 1000, x.astype(np.uint16), y.astype(np.uint16), p)


class Encoder(_Encoder):
    """Encodes events as DVXplorer Mini words; events of one time leave by column, then row, as the device reads out."""

    encoding = "dvxplorer_mini"
    word = np.dtype("<u4")
    columns, rows, channels = 640, 480, 0
    width, height = 640, 480

    def __init__(self, resync: bool = False) -> None:
        super().__init__(resync)
        self._t_us = -1
        self._ms: int | None = None

    def encode(self, events: Events) -> bytes:
        """Encodes events as words. Each call starts a new readout: its first time must be later than the last of the
        call before.
        """
        self._check(events)
        if not len(events):
            return b""
        t_us = events.t // 1000
        if t_us[0] <= self._t_us or (np.diff(t_us) < 0).any():
            raise ValueError(
                "dvxplorer_mini sends whole readouts: times must not step back, and each call must start at a later us "
                "than the last one ended; sort the events by time or write .npz"
            )
        order = np.lexsort((events.y, events.p, events.y >> 3, events.x, t_us))
        events, t_us = events[order], t_us[order]
        heads, masks = find_groups(t_us, events)
        t, x = t_us[heads], events.x[heads].astype(np.int64)
        starts = np.diff(t, prepend=-1) != 0
        ms = t // 1000
        steps = {
            int(i): self._references(int(ms[i - 1]) if i else self._ms, int(ms[i]))
            for i in np.flatnonzero(np.diff(ms, prepend=-1 if self._ms is None or self.resync else self._ms))
        }
        new_column = starts | (np.diff(x, prepend=-1) != 0)
        column = COLUMN | starts << START_SHIFT | np.where(starts, t % 1000, 0) << SUB_SHIFT | x
        off = 1 - events.p[heads].astype(np.int64)
        group = GROUPS | events.y[heads].astype(np.int64) >> 3 << FIRST_SHIFT | off << SIGN_SHIFT | masks
        flat = np.stack([column, group], axis=1)[np.stack([new_column, np.ones(len(t), bool)], axis=1)]
        at = np.cumsum(new_column + 1) - (new_column + 1)
        if steps:
            place = np.repeat(at[list(steps)], [len(w) for w in steps.values()])
            flat = np.insert(flat, place, np.concatenate(list(steps.values())))
        self._t_us, self._ms = int(t[-1]), int(ms[-1])
        return flat.astype(self.word).tobytes()

    def advance(self, t_ns: int) -> bytes:
        """Encodes the reference word up to t_ns."""
        ms = t_ns // 1_000_000
        if self._ms is not None and ms <= self._ms:
            return b""
        words = self._references(self._ms, ms)
        self._ms = ms
        return words.astype(self.word).tobytes()

    def _references(self, before: int | None, ms: int) -> np.ndarray:
        """Makes the reference words after that for `before` [ms], none less than half a turn apart where turns pass."""
        half = 1 << REFERENCE_BITS - 1
        turns = (ms >> REFERENCE_BITS) - ((before or 0) >> REFERENCE_BITS)
        if turns > MAX_TURNS:
            raise ValueError(
                f"dvxplorer_mini counts from 0 in turns of 4194 s; a jump to {ms / 1e3:.6g} s is too far; {REBASE}"
            )
        if not turns:
            return np.array([REFERENCE | ms & REFERENCE_MASK])
        first = (before or 0) // half + 1 if before is not None else 0
        passed = np.arange(first, -(-ms // half), dtype=np.int64) * half
        return REFERENCE | np.append(passed, ms) & REFERENCE_MASK
