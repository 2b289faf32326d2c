"""Decodes and encodes Prophesee EVT3: 16-bit words, time 24 bits in us, single events and vectors of 12 and 8 pixels.

Rules as in openeb: nothing counts before the first TIME_HIGH; the 24-bit counter has turned when TIME_HIGH falls by
2048 or more; a change of TIME_HIGH sets the low part to 0; a TIME_LOW that steps back is kept as it is.
"""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.codecs import decoder
from evis.events.codecs.encoder import MergedStream, PropheseeEncoder, reserve_words, scatter

ADDR_Y, ADDR_X, VECT_BASE_X, VECT_12, VECT_8, TIME_LOW, TIME_HIGH, TRIGGER = 0, 2, 3, 4, 5, 6, 8, 10

PADDING = (14, 15)
CONTINUED = 7
"""Types that mean nothing to a decoder, and are no fault either: padding, and what continues another word."""
IN_RUNS = (ADDR_Y, ADDR_X, TIME_LOW, CONTINUED, *PADDING)
"""Types that `evt3_run` of the kernel decodes."""
VECTOR_PIXELS = {VECT_12: 12, VECT_8: 8}
ADDRESS = 0x7FF
"""Bits of a row or a column."""
HALF_TURN = 1 << 11
"""A fall of TIME_HIGH from which on its 12 bits have turned."""

# places in the state vector, shared with the kernel
TIMED, HIGH, LOW, LOOP, ROW, BASE, SIGN, OUTSIDE, UNTIMED, UNKNOWN = range(10)

# what each word type is worth to the decoder, by type
_WIDTHS = np.zeros(16, np.int64)
_WIDTHS[list(VECTOR_PIXELS)] = list(VECTOR_PIXELS.values())
_TIMES = np.zeros(16, bool)
_TIMES[[ADDR_X, VECT_12, VECT_8, TRIGGER]] = True
_KNOWN = [ADDR_Y, ADDR_X, VECT_BASE_X, VECT_12, VECT_8, TIME_LOW, CONTINUED, TIME_HIGH, TRIGGER, *PADDING]
_NOT_KNOWN = ~np.isin(np.arange(16), _KNOWN)


class Decoder(decoder.Decoder):
    """Decodes EVT3 words to events. See `evis.events.codecs.decoder.Decoder`."""

    encoding = "evt3"
    word = np.dtype("<u2")
    wrap_ns = 1000 << 24
    state_size = 10
    counters = {"outside": OUTSIDE, "untimed": UNTIMED, "unknown": UNKNOWN}
    kernel = "evis.events.codecs.prophesee.evt3_kernels:decode_evt3"

    def _reset_context(self) -> None:
        self.state[[LOW, ROW, BASE, SIGN]] = 0

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes words by numpy, the twin of the kernel: positions of each kind of word, how many came before each
        event.
        """
        state, skipped = self.state, 0
        if state[TIMED] <= 0:
            highs = np.flatnonzero(words >> 12 == TIME_HIGH)
            skipped = int(highs[0]) if len(highs) else len(words)
            state[UNTIMED] += skipped
            words = words[skipped:]
        if not len(words):
            return Events.empty(), skipped, -1
        kind, value = (words >> 12).astype(np.uint8), words & 0xFFF
        timed = np.flatnonzero(_TIMES[kind])
        clock = _Clock(state, kind, value)
        times = clock.at(timed)
        late = times > limit
        next_us, cut = -1, len(words)
        if late.any():
            first = int(np.argmax(late))
            next_us, cut = int(times[first]), int(timed[first])
            kind, value, timed, times = kind[:cut], value[:cut], timed[:first], times[:first]
        clock.store(state, cut)
        state[UNKNOWN] += np.count_nonzero(_NOT_KNOWN[kind])
        is_trigger = kind[timed] == TRIGGER
        events = self._events(kind, value, timed[~is_trigger], times[~is_trigger])
        if is_trigger.any():
            edge = value[timed[is_trigger]]
            events.triggers = Triggers(
                times[is_trigger] * 1000, (edge >> 8 & 15).astype(np.uint8), (edge & 1).astype(np.uint8)
            )
        return events, skipped + cut, next_us

    def _events(self, kind: np.ndarray, value: np.ndarray, at: np.ndarray, times: np.ndarray) -> Events:
        """Decodes the events of the words `at`; returns them and the address part of the state after all words."""
        state = self.state
        rows = np.flatnonzero(kind == ADDR_Y)
        y_values = np.concatenate([state[ROW : ROW + 1], value[rows].astype(np.int64) & ADDRESS])
        bases = np.flatnonzero(kind == VECT_BASE_X)
        word = value[bases].astype(np.int64)
        base_values = np.concatenate([state[BASE : BASE + 1], word & ADDRESS])
        sign_values = np.concatenate([state[SIGN : SIGN + 1], word >> 11])
        # pixels that all vectors have moved the base by before each word, and before the base in force was set
        moved = np.concatenate([[0], np.cumsum(_WIDTHS[kind])])
        moved_at_base = np.concatenate([[0], moved[bases]])

        single = kind[at] == ADDR_X
        word = value[at].astype(np.int64)
        base = decoder.count_until(kind == VECT_BASE_X, at)
        column = np.where(single, word & ADDRESS, base_values[base] + moved[at] - moved_at_base[base])
        sign = np.where(single, word >> 11, sign_values[base])
        mask = np.where(single, 1, np.where(kind[at] == VECT_8, word & 0xFF, word)).astype("<u2")
        state[ROW] = y_values[-1]
        state[BASE] = (base_values[-1] + moved[-1] - moved_at_base[-1]) & 0xFFFF
        state[SIGN] = sign_values[-1]

        bits = np.unpackbits(mask.view(np.uint8).reshape(-1, 2), axis=1, bitorder="little")
        flat = np.flatnonzero(bits.reshape(-1).view(bool))
        of = flat >> 4
        x = (column[of] + (flat & 15)) & 0xFFFF
        y = y_values[decoder.count_until(kind == ADDR_Y, at)][of]
        t, p = times[of] * 1000, sign[of]
        keep = np.ones(len(x), bool)
        if self.height:
            keep &= y < self.height
        if self.width:
            keep &= x < self.width
        if not keep.all():
            state[OUTSIDE] += np.count_nonzero(~keep)
            t, x, y, p = t[keep], x[keep], y[keep], p[keep]
        return Events(t, x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8))


class _Clock:
    """Computes the current time at each word."""

    def __init__(self, state: np.ndarray, kind: np.ndarray, value: np.ndarray) -> None:
        self.kind = kind
        self.highs = np.flatnonzero(kind == TIME_HIGH)
        high = value[self.highs].astype(np.int64)
        first = state[HIGH] if state[TIMED] or not len(high) else high[0]
        before = np.concatenate([[first], high])
        turns = np.cumsum(before[:-1] >= high + HALF_TURN)
        self.high = before if state[TIMED] else np.concatenate([[0], high])
        self.loop = state[LOOP] + np.concatenate([[0], turns])
        self.lows = np.flatnonzero(kind == TIME_LOW)
        self.low = np.append(state[LOW], value[self.lows])
        # a change of TIME_HIGH is a TIME_LOW of 0: it counts where it is the later one of the two
        place = np.where(high != before[:-1], self.highs, -1)
        self.changed = np.append(-1, np.maximum.accumulate(place))
        self.set = np.append(-1, self.lows)
        self.any = state[TIMED] > 0

    def at(self, words: np.ndarray) -> np.ndarray:
        """Returns the time [us] at the given word positions, int64."""
        h, l = decoder.count_until(self.kind == TIME_HIGH, words), decoder.count_until(self.kind == TIME_LOW, words)
        low = np.where(self.changed[h] > self.set[l], 0, self.low[l])
        return (self.loop[h] << 24) + (self.high[h] << 12) + low

    def store(self, state: np.ndarray, cut: int) -> None:
        """Stores the time before word `cut` in the state."""
        h, l = int(np.searchsorted(self.highs, cut)), int(np.searchsorted(self.lows, cut))
        state[TIMED] = int(self.any or h > 0)
        state[HIGH], state[LOOP] = self.high[h], self.loop[h]
        state[LOW] = 0 if self.changed[h] > self.set[l] else self.low[l]


class Encoder(PropheseeEncoder):
    """Encodes events as EVT3.

    Runs of five or more pixels of one time, row and polarity in an aligned block of 32 columns become vectors (12 + 12
    + 8 bits, always together, as the sensors send them); others single words.
    """

    encoding = "evt3"
    high_bits, low_bits = 12, 12
    columns, rows, channels = 2048, 2048, 16
    word = np.dtype("<u2")

    def time_high_words(self, high: np.ndarray) -> np.ndarray:
        """Makes TIME_HIGH words."""
        return TIME_HIGH << 12 | high & 0xFFF

    def _write(self, item: MergedStream, new_high: np.ndarray, steps: dict[int, np.ndarray]) -> np.ndarray:
        n = len(item.t_us)
        events, t_us = ~item.is_trigger, item.t_us
        low = t_us & 0xFFF
        before = np.concatenate([[self._low], low[:-1]])
        new_low = new_high | (low != before)
        row = np.where(events, item.y, -1)
        last = np.maximum.accumulate(np.where(events, np.arange(n), -1))
        previous = np.concatenate([[-1], last[:-1]])
        before = np.where(previous >= 0, row[previous], self._row)
        new_row = events & (row != before)

        heads, size = find_vectors(item, new_high | new_low | new_row)
        member = np.repeat(heads, size)
        big = np.repeat(size >= 5, size)
        head = np.zeros(n, bool)
        head[heads] = True
        payload = np.where(big, np.where(head, 4, 0), 1)
        out, at = reserve_words(payload + new_high + new_low + new_row, steps)
        at = scatter(out, at, new_high, self.time_high_words(t_us >> 12))
        at = scatter(out, at, new_low, TIME_LOW << 12 | low)
        at = scatter(out, at, new_row, ADDR_Y << 12 | item.y)
        word = np.where(events, ADDR_X << 12 | item.p << 11 | item.x, TRIGGER << 12 | item.x << 8 | item.p)
        scatter(out, at, ~big, word)
        scatter(out, at, big & head, VECT_BASE_X << 12 | item.p << 11 | item.x & ~31)
        bit = np.where(big, 1 << (item.x & 31), 0)
        mask = np.bincount(member, bit, n).astype(np.int64)[big & head]
        at = at[big & head] + 1
        out[at] = VECT_12 << 12 | mask & 0xFFF
        out[at + 1] = VECT_12 << 12 | mask >> 12 & 0xFFF
        out[at + 2] = VECT_8 << 12 | mask >> 24
        self._low = int(low[-1])
        if last[-1] >= 0:
            self._row = int(row[last[-1]])
        return out


def find_vectors(item: MergedStream, new: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Finds the runs of items that one vector of 32 aligned columns can hold in their order: first items, and sizes."""
    n = len(item.t_us)
    joins = np.zeros(n, bool)
    same = (item.p[1:] == item.p[:-1]) & (item.x[1:] >> 5 == item.x[:-1] >> 5) & (item.x[1:] > item.x[:-1])
    joins[1:] = same & ~new[1:] & ~item.is_trigger[1:] & ~item.is_trigger[:-1]
    heads = np.flatnonzero(~joins)
    return heads, np.diff(np.concatenate([heads, [n]]))
