"""Prophesee EVT2: 32-bit words, one event each, time 34 bits in us.

The rules are those of EVT3: nothing counts before the first TIME_HIGH, and the counter has turned when TIME_HIGH falls
by half its range or more.
"""

from __future__ import annotations

import numpy as np

from evis.streams import decoder
from evis.streams.encoder import Encoder as _Encoder
from evis.streams.encoder import Item, scatter
from evis.streams.events import Events, Triggers

OFF, ON, TIME_HIGH, TRIGGER = 0, 1, 8, 10

# places in the state vector, shared with the kernel
_TIMED, _HIGH, _LOOP, _OUTSIDE, _UNTIMED = range(5)


class Decoder(decoder.Decoder):
    """EVT2 words to events. See `evis.streams.decoder.Decoder`."""

    encoding = "evt2"
    word = np.dtype("<u4")
    wrap_ns = 1000 << 34
    state_size = 5

    @property
    def outside(self) -> int:
        """Events dropped because they lie outside width x height."""
        return int(self.state[_OUTSIDE])

    @property
    def untimed(self) -> int:
        """Words dropped because no TIME_HIGH had come yet."""
        return int(self.state[_UNTIMED])

    def decode_words(self, words: np.ndarray, limit_us: int) -> tuple[Events, int, int]:
        """The vectorised reference."""
        state, skipped = self.state, 0
        kind = words >> 28
        if not state[_TIMED]:
            first = np.flatnonzero(kind == TIME_HIGH)
            skipped = int(first[0]) if len(first) else len(words)
            state[_UNTIMED] += skipped
            words, kind = words[skipped:], kind[skipped:]
        if not len(words):
            return Events.empty(), skipped, -1
        highs = np.flatnonzero(kind == TIME_HIGH)
        value = (words[highs] & 0xFFFFFFF).astype(np.int64)
        before = np.concatenate([state[_HIGH : _HIGH + 1] if state[_TIMED] else value[:1], value])
        loop = state[_LOOP] + np.concatenate([[0], np.cumsum(before[:-1] >= value + (1 << 27))])
        if not state[_TIMED]:
            before[0] = 0
        base = (loop << 34) + (before << 6)

        timed = np.flatnonzero((kind <= ON) | (kind == TRIGGER))
        word = words[timed]
        times = base[np.searchsorted(highs, timed)] + (word >> 22 & 63).astype(np.int64)
        late = times > limit_us
        next_us, cut = -1, len(words)
        if late.any():
            first_late = int(np.argmax(late))
            next_us, cut = int(times[first_late]), int(timed[first_late])
            timed, word, times = timed[:first_late], word[:first_late], times[:first_late]
        h = int(np.searchsorted(highs, cut))
        state[_TIMED] |= h > 0
        state[_HIGH], state[_LOOP] = before[h], loop[h]
        return self._events(kind[timed], word, times), skipped + cut, next_us

    def _events(self, kind: np.ndarray, word: np.ndarray, times: np.ndarray) -> Events:
        edge = kind == TRIGGER
        triggers = Triggers()
        if edge.any():
            bits = word[edge]
            triggers = Triggers(times[edge] * 1000, (bits >> 8 & 31).astype(np.uint8), (bits & 1).astype(np.uint8))
            kind, word, times = kind[~edge], word[~edge], times[~edge]
        x, y = (word >> 11 & 0x7FF).astype(np.uint16), (word & 0x7FF).astype(np.uint16)
        keep = np.ones(len(x), bool)
        if self.height:
            keep &= y < self.height
        if self.width:
            keep &= x < self.width
        if not keep.all():
            self.state[_OUTSIDE] += np.count_nonzero(~keep)
            x, y, kind, times = x[keep], y[keep], kind[keep], times[keep]
        return Events(times * 1000, x, y, kind.astype(np.uint8), triggers=triggers)


class Encoder(_Encoder):
    """Events to EVT2, one word each."""

    encoding = "evt2"
    high_bits, low_bits = 28, 6
    columns, rows, channels = 2048, 2048, 32
    word = np.dtype("<u4")

    def time_high_words(self, high: np.ndarray) -> np.ndarray:
        """TIME_HIGH words."""
        return TIME_HIGH << 28 | high & 0xFFFFFFF

    def _write(self, item: Item, new_high: np.ndarray, steps: dict[int, np.ndarray]) -> np.ndarray:
        extra = np.zeros(len(item.t_us), np.int64)
        extra[list(steps)] = [len(s) for s in steps.values()]
        lengths = extra + new_high + 1
        start = np.cumsum(lengths) - lengths
        out = np.zeros(int(lengths.sum()), np.int64)
        for i, words in steps.items():
            out[start[i] : start[i] + len(words)] = words
        at = scatter(out, start + extra, new_high, self.time_high_words(item.t_us >> 6))
        low = (item.t_us & 63) << 22
        out[at] = np.where(
            item.is_trigger,
            TRIGGER << 28 | low | item.x << 8 | item.p,
            item.p << 28 | low | item.x << 11 | item.y,
        )
        return out
