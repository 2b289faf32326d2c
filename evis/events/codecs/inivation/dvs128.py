"""Decodes and encodes DVS128 over USB: 32-bit words, an address and a 14-bit time each.

Bits 0-15 are the address (0 polarity, inverted; 1-7 x and 8-14 y, both counted from the far corner; 15 an edge of the
synchronisation input), bits 16-29 the time in us. Bit 31: the time has wrapped (+2^14 us); bit 30: it was reset.
"""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.codecs import decoder
from evis.events.codecs.encoder import REBASE, merge
from evis.events.codecs.encoder import Encoder as _Encoder
from evis.events.codecs.inivation.words import MAX_OFFSET_US

OFFSET, OUTSIDE, RESETS = 1, 2, 3
"""Places in the state vector."""
WRAP, RESET, EDGE = 1 << 31, 1 << 30, 1 << 15
TIME_SHIFT, Y_SHIFT, X_SHIFT, PIXEL_MASK = 16, 8, 1, 127
TURN_BITS = 14
MAX_WRAPS = 1_000_000
"""Wrap words in a row (four and a half hours) beyond which times do not count from the device's start."""


class Decoder(decoder.Decoder):
    """Decodes DVS128 words to events; edges of the synchronisation input are rising triggers of channel 0."""

    encoding = "dvs128"
    word = np.dtype("<u4")
    wrap_ns = 1000 << TURN_BITS
    state_size = 4
    counters = {"outside": OUTSIDE, "timestamp_resets": RESETS}
    geometry = (128, 128)
    kernel = "evis.events.codecs.inivation.dvs128_kernels:decode_dvs128"

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes words by numpy, the twin of the kernel."""
        state = self.state
        is_wrap = words >= WRAP
        is_reset = ~is_wrap & (words & RESET != 0)
        total = state[OFFSET] + np.cumsum(is_wrap.astype(np.int64) << TURN_BITS)
        last = np.maximum.accumulate(np.where(is_reset, np.arange(len(words)), -1))
        base = np.minimum(np.where(last >= 0, total - total[last], total), MAX_OFFSET_US) if len(words) else total
        timed = np.flatnonzero(~is_wrap & ~is_reset)
        times = base[timed] + (words[timed] >> TIME_SHIFT).astype(np.int64)
        late = times > limit
        following, cut = -1, len(words)
        if late.any():
            i = int(np.argmax(late))
            following, cut = int(times[i]), int(timed[i])
            timed, times = timed[:i], times[:i]
        if cut:
            state[OFFSET] = base[cut - 1]
            state[RESETS] += np.count_nonzero(is_reset[:cut])
        word = words[timed]
        edge = word & EDGE != 0
        triggers = Triggers()
        if edge.any():
            n = int(np.count_nonzero(edge))
            triggers = Triggers(times[edge] * 1000, np.zeros(n, np.uint8), np.ones(n, np.uint8))
            word, times = word[~edge], times[~edge]
        x, y = (PIXEL_MASK - (word >> shift & PIXEL_MASK).astype(np.uint16) for shift in (X_SHIFT, Y_SHIFT))
        p = (~word & 1).astype(np.uint8)
        keep = (x < self.width) & (y < self.height)
        if not keep.all():
            state[OUTSIDE] += np.count_nonzero(~keep)
            x, y, p, times = x[keep], y[keep], p[keep], times[keep]
        return Events(times * 1000, x, y, p, triggers=triggers), cut, following


class Encoder(_Encoder):
    """Encodes events and rising triggers of channel 0 as DVS128 words."""

    encoding = "dvs128"
    word = np.dtype("<u4")
    columns, rows, channels = 128, 128, 1
    width, height = 128, 128

    def __init__(self, resync: bool = False) -> None:
        super().__init__(resync)
        self._turn = 0

    def encode(self, events: Events) -> bytes:
        """Encodes events as words, with a wrap word for every turn of 16.4 ms."""
        self._check(events)
        if len(events.triggers) and not events.triggers.value.all():
            raise ValueError("dvs128 has rising triggers only")
        item = merge(events)
        if not len(item.t_us):
            return b""
        turn = item.t_us >> TURN_BITS
        steps = np.diff(turn, prepend=self._turn)
        if steps.min() < 0:
            raise ValueError(
                "dvs128 cannot hold times that step back over a turn of its counter (16.4 ms); sort the events by time"
            )
        self._limit(int(steps.sum()))
        address = (PIXEL_MASK - item.x) << X_SHIFT | (PIXEL_MASK - item.y) << Y_SHIFT | 1 - item.p
        words = np.where(item.is_trigger, EDGE, address) | (item.t_us & (1 << TURN_BITS) - 1) << TIME_SHIFT
        self._turn = int(turn[-1])
        return np.insert(words, np.repeat(np.arange(len(words)), steps), WRAP).astype(self.word).tobytes()

    def advance(self, t_ns: int) -> bytes:
        """Encodes the wrap words up to t_ns, as a device without events sends them."""
        steps = max((t_ns // 1000 >> TURN_BITS) - self._turn, 0)
        self._limit(steps)
        self._turn += steps
        return np.full(steps, WRAP, self.word).tobytes()

    def _limit(self, wraps: int) -> None:
        if wraps > MAX_WRAPS:
            raise ValueError(
                f"dvs128 counts from 0 in turns of 16.4 ms; a jump of {wraps * 0.016384:.6g} s is too far; {REBASE}"
            )
