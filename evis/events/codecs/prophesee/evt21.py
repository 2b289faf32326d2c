"""Decodes and encodes Prophesee EVT2.1: 64-bit words; the upper half is an EVT2 word, the lower half a mask of 32
pixels from its x on.

Time, triggers and turns are those of EVT2. `evt21` is plain little endian; `evt21_legacy` (IMX636) sends the upper half
first (`endianness=legacy` in a RAW header).
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from evis.events.codecs.encoder import MergedStream, PropheseeEncoder, reserve_words, scatter
from evis.events.codecs.prophesee import evt2
from evis.events.codecs.prophesee.evt2 import (
    ADDRESS_MASK,
    CHANNEL_SHIFT,
    HIGH_MASK,
    HIGH_SHIFT,
    LOW_MASK,
    LOW_SHIFT,
    TIME_HIGH,
    TRIGGER,
    TYPE_SHIFT,
    X_SHIFT,
)
from evis.events.codecs.prophesee.evt3 import find_vectors


class Decoder(evt2.Decoder):
    """Decodes EVT2.1 words to events. See `evis.events.codecs.decoder.Decoder`."""

    encoding = "evt21"
    word: ClassVar[np.dtype[Any]] = np.dtype("<u8")
    kernel = "evis.events.codecs.prophesee.evt2_kernels:decode_evt21"

    def _heads(self, words: np.ndarray) -> np.ndarray:
        return (words >> np.uint64(32)).astype(np.uint32)

    def _addresses(self, word: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        masks = (word & np.uint64(0xFFFFFFFF)).astype("<u4")
        bits = np.unpackbits(masks.view(np.uint8), bitorder="little")
        flat = np.flatnonzero(bits.view(bool))
        of = flat >> 5
        heads = self._heads(word)[of]
        x = (heads >> X_SHIFT & ADDRESS_MASK) + (flat & 31).astype(np.uint32)
        return x.astype(np.uint16), (heads & ADDRESS_MASK).astype(np.uint16), of


class Encoder(PropheseeEncoder):
    """Encodes events as EVT2.1: neighbours of one time, row and polarity in an aligned block of 32 columns share a
    word.
    """

    encoding = "evt21"
    high_bits, low_bits = 28, 6
    columns, rows, channels = 2048, 2048, 32
    word: ClassVar[np.dtype[Any]] = np.dtype("<u8")

    def time_high_words(self, high: np.ndarray) -> np.ndarray:
        """Makes TIME_HIGH words."""
        return (TIME_HIGH << TYPE_SHIFT | high & HIGH_MASK).astype(np.uint64) << np.uint64(32)

    def _write(self, item: MergedStream, new_high: np.ndarray, steps: dict[int, np.ndarray]) -> np.ndarray:
        n = len(item.t_us)
        new = np.ones(n, bool)
        new[1:] = new_high[1:] | (item.t_us[1:] != item.t_us[:-1]) | (item.y[1:] != item.y[:-1])
        heads, _ = find_vectors(item, new)
        is_head = np.zeros(n, bool)
        is_head[heads] = True
        out, start = reserve_words(new_high + is_head.astype(np.int64), steps, np.uint64)
        at = scatter(out, start, new_high, self.time_high_words(item.t_us >> HIGH_SHIFT))
        low = (item.t_us & LOW_MASK) << LOW_SHIFT
        upper = np.where(
            item.is_trigger,
            TRIGGER << TYPE_SHIFT | low | item.x << CHANNEL_SHIFT | item.p,
            item.p << TYPE_SHIFT | low | (item.x & ~31) << X_SHIFT | item.y,
        )
        bit = np.where(item.is_trigger, 0, 1 << (item.x & 31))
        mask = np.add.reduceat(bit, heads)
        out[at[heads]] = upper[heads].astype(np.uint64) << np.uint64(32) | mask.astype(np.uint64)
        return out
