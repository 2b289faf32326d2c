"""Decodes and encodes Prophesee EVT4: 32-bit words, an event each, or a vector: a word with the first pixel, then a
mask of 32 pixels.

Time, triggers and turns are those of EVT2, under other type numbers: 0xA OFF, 0xB ON, 0xC and 0xD the vectors, 0xE
TIME_HIGH, 9 a trigger. 6 and 7 are counts that the sensor makes, 0xF is padding.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.prophesee import evt2, evt21

OFF, ON, VECTOR_OFF, VECTOR_ON, TIME_HIGH, TRIGGER = 0xA, 0xB, 0xC, 0xD, 0xE, 0x9
COUNTS, PADDING = (0x6, 0x7), 0xF
_AS_EVT2 = np.full(16, 2, np.uint32)
_AS_EVT2[[OFF, ON, VECTOR_OFF, VECTOR_ON]] = [evt2.OFF, evt2.ON, evt2.OFF, evt2.ON]
_AS_EVT2[[TIME_HIGH, TRIGGER]] = [evt2.TIME_HIGH, evt2.TRIGGER]
_AS_EVT2[[*COUNTS, PADDING]] = max(evt2.PADDING)
"""The type of EVT2 for each of EVT4; 2 is unknown to both."""
_TYPES = np.zeros(16, np.uint32)
_TYPES[[evt2.OFF, evt2.ON, evt2.TIME_HIGH, evt2.TRIGGER]] = [OFF, ON, TIME_HIGH, TRIGGER]

OPEN = 6
"""Place in the state vector, behind those of EVT2: the vector whose mask has not come yet, 0 for none."""


class Decoder(evt21.Decoder):
    """Decodes EVT4 words to events. See `evis.events.codecs.decoder.Decoder`."""

    encoding = "evt4"
    word: ClassVar[np.dtype[Any]] = np.dtype("<u4")
    state_size = 7
    kernel = "evis.events.codecs.prophesee.evt4_kernels:decode_evt4"

    def _reset_context(self) -> None:
        self.state[OPEN] = 0

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes words by numpy, the twin of the kernel: each event, vector or other word as a word of EVT2.1."""
        if not len(words):
            return Events.empty(), 0, -1
        opened = int(self.state[OPEN])
        is_vector = (words >> 29) == VECTOR_OFF >> 1
        is_vector[: bool(opened)] = False
        # words in a row that look like vectors are vectors and their masks by turns
        places = np.arange(len(words))
        first = np.maximum.accumulate(np.where(is_vector & ~np.append(False, is_vector[:-1]), places, -1))
        is_vector &= (places - first) % 2 == 0
        is_mask = np.append(bool(opened), is_vector[:-1])
        masks = np.append(words[1:], 0)
        single = (words >> 29) == OFF >> 1
        lower = np.where(is_vector, masks, single)[~is_mask]
        at, upper = places[~is_mask], words[~is_mask]
        if opened and self.state[evt2.TIMED] > 0:  # one without a time was counted with its first word
            at, upper = np.append(0, at), np.append(np.uint32(opened), upper)
            lower = np.append(words[0], lower)
        upper = _AS_EVT2[upper >> evt2.TYPE_SHIFT] << evt2.TYPE_SHIFT | upper & evt2.HIGH_MASK
        units = upper.astype(np.uint64) << np.uint64(32) | lower.astype(np.uint64)
        events, used, following = super().decode_words(units, limit)
        if used == len(units):
            self.state[OPEN] = int(words[-1]) if is_vector[-1] else 0
            return events, len(words), following
        if used:
            self.state[OPEN] = 0
        return events, int(at[used]), following


class Encoder(evt21.Encoder):
    """Encodes events as EVT4: neighbours as in EVT2.1 share a vector, others have a word each."""

    encoding = "evt4"
    word: ClassVar[np.dtype[Any]] = np.dtype("<u4")

    def _pack(self, words: np.ndarray) -> bytes:
        words = words.astype(np.uint64)
        upper, mask = (words >> np.uint64(32)).astype(np.uint32), words.astype(np.uint32)
        kind = upper >> evt2.TYPE_SHIFT
        event = kind <= evt2.ON
        several = event & (mask & mask - (mask > 0) != 0)
        column = np.log2(np.maximum(mask, 1)).astype(np.uint32)
        first = (_TYPES[kind] + (VECTOR_OFF - OFF) * several) << evt2.TYPE_SHIFT | upper & evt2.HIGH_MASK
        first += np.where(event & ~several, column << evt2.X_SHIFT, 0).astype(np.uint32)
        pairs = np.stack([first, mask], axis=1)
        return pairs[np.stack([np.ones(len(first), bool), several], axis=1)].astype(self.word).tobytes()
