"""Decodes and encodes Prophesee EVT2: 32-bit words, one event each, time 34 bits in us.

The rules are those of EVT3: nothing counts before the first TIME_HIGH, and the counter has turned when TIME_HIGH falls
by half its range or more.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.codecs import decoder
from evis.events.codecs.encoder import MergedStream, PropheseeEncoder, reserve_words, scatter

OFF, ON, TIME_HIGH, TRIGGER = 0, 1, 8, 10
PADDING = (14, 15)
"""Types that mean nothing to a decoder, and are no fault either."""

# the fields of a word: type, low bits of the time, then x and y, or the channel and the value of a trigger
TYPE_SHIFT, LOW_SHIFT, X_SHIFT, CHANNEL_SHIFT = 28, 22, 11, 8
HIGH_MASK, LOW_MASK, ADDRESS_MASK, CHANNEL_MASK = (1 << 28) - 1, 63, 0x7FF, 31
HIGH_SHIFT, TURN_SHIFT = 6, 34
"""Of a time in us: its high bits, and the turns of those."""
HALF_TURN = 1 << 27
"""A fall of TIME_HIGH from which on its 28 bits have turned."""

MAX_LOOP = 1 << 18
"""Turns that are counted: 143 years, far beyond which int64 ns would overflow."""

_KNOWN = np.isin(np.arange(16), [OFF, ON, TIME_HIGH, TRIGGER, *PADDING])

# places in the state vector, shared with the kernel
TIMED, HIGH, LOOP, OUTSIDE, UNTIMED, UNKNOWN = range(6)


class Decoder(decoder.Decoder):
    """Decodes EVT2 words to events. See `evis.events.codecs.decoder.Decoder`."""

    encoding = "evt2"
    word: ClassVar[np.dtype[Any]] = np.dtype("<u4")
    wrap_ns = 1000 << 34
    state_size = 6
    counters = {"outside": OUTSIDE, "untimed": UNTIMED, "unknown": UNKNOWN}
    kernel = "evis.events.codecs.prophesee.evt2_kernels:decode_evt2"

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes words by numpy, the twin of the kernel."""
        state, skipped = self.state, 0
        heads = self._heads(words)
        kind = heads >> TYPE_SHIFT
        if state[TIMED] <= 0:
            first = np.flatnonzero(kind == TIME_HIGH)
            skipped = int(first[0]) if len(first) else len(words)
            state[UNTIMED] += skipped
            words, heads, kind = words[skipped:], heads[skipped:], kind[skipped:]
        if not len(words):
            return Events.empty(), skipped, -1
        highs = np.flatnonzero(kind == TIME_HIGH)
        value = (heads[highs] & HIGH_MASK).astype(np.int64)
        before = np.concatenate([state[HIGH : HIGH + 1] if state[TIMED] else value[:1], value])
        turns = np.concatenate([[0], np.cumsum(before[:-1] >= value + HALF_TURN)])
        loop = np.minimum(state[LOOP] + turns, MAX_LOOP)
        if not state[TIMED]:
            before[0] = 0
        base = (loop << TURN_SHIFT) + (before << HIGH_SHIFT)

        timed = np.flatnonzero((kind <= ON) | (kind == TRIGGER))
        times = base[decoder.count_until(kind == TIME_HIGH, timed)] + (heads[timed] >> LOW_SHIFT & LOW_MASK).astype(
            np.int64
        )
        late = times > limit
        next_us, cut = -1, len(words)
        if late.any():
            first_late = int(np.argmax(late))
            next_us, cut = int(times[first_late]), int(timed[first_late])
            timed, times = timed[:first_late], times[:first_late]
        h = int(np.searchsorted(highs, cut))
        state[TIMED] = int(state[TIMED] > 0 or h > 0)
        state[UNKNOWN] += np.count_nonzero(~_KNOWN[kind[:cut]])
        state[HIGH], state[LOOP] = before[h], loop[h]
        return self._events(words[timed], kind[timed], times), skipped + cut, next_us

    def _heads(self, words: np.ndarray) -> np.ndarray:
        """Returns each word as an EVT2 word: type, low time and address."""
        return words

    def _events(self, word: np.ndarray, kind: np.ndarray, times: np.ndarray) -> Events:
        edge = kind == TRIGGER
        triggers = Triggers()
        if edge.any():
            bits = self._heads(word[edge])
            triggers = Triggers(
                times[edge] * 1000, (bits >> CHANNEL_SHIFT & CHANNEL_MASK).astype(np.uint8), (bits & 1).astype(np.uint8)
            )
            kind, word, times = kind[~edge], word[~edge], times[~edge]
        x, y, of = self._addresses(word)
        keep = np.ones(len(x), bool)
        if self.height:
            keep &= y < self.height
        if self.width:
            keep &= x < self.width
        if not keep.all():
            self.state[OUTSIDE] += np.count_nonzero(~keep)
            x, y, of = x[keep], y[keep], np.arange(len(keep))[keep] if of is None else of[keep]
        if of is not None:
            kind, times = kind[of], times[of]
        return Events(times * 1000, x, y, kind.astype(np.uint8), triggers=triggers)

    def _addresses(self, word: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Returns x, y and the word of each event; None for the last where each word is one event."""
        return (word >> X_SHIFT & ADDRESS_MASK).astype(np.uint16), (word & ADDRESS_MASK).astype(np.uint16), None


class Encoder(PropheseeEncoder):
    """Encodes events as EVT2, one word each."""

    encoding = "evt2"
    high_bits, low_bits = 28, 6
    columns, rows, channels = 2048, 2048, 32
    word = np.dtype("<u4")

    def time_high_words(self, high: np.ndarray) -> np.ndarray:
        """Makes TIME_HIGH words."""
        return TIME_HIGH << TYPE_SHIFT | high & HIGH_MASK

    def _write(self, item: MergedStream, new_high: np.ndarray, steps: dict[int, np.ndarray]) -> np.ndarray:
        out, start = reserve_words(new_high + 1, steps)
        at = scatter(out, start, new_high, self.time_high_words(item.t_us >> HIGH_SHIFT))
        low = (item.t_us & LOW_MASK) << LOW_SHIFT
        out[at] = np.where(
            item.is_trigger,
            TRIGGER << TYPE_SHIFT | low | item.x << CHANNEL_SHIFT | item.p,
            item.p << TYPE_SHIFT | low | item.x << X_SHIFT | item.y,
        )
        return out
