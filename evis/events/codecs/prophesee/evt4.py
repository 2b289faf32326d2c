"""Prophesee EVT4: 32-bit words, an event each, or a vector: a word with the first pixel, then a mask of 32 pixels.

Time, triggers and turns are those of EVT2, under other type numbers: 0xA OFF, 0xB ON, 0xC and 0xD the vectors, 0xE
TIME_HIGH, 9 a trigger. 6 and 7 are counts that the sensor makes, 0xF is padding.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.prophesee import evt2, evt21

_VECTOR_OFF = 0xC
_AS_EVT2 = np.full(16, 2, np.uint32)
_AS_EVT2[[0xA, 0xB, 0xC, 0xD, 0xE, 0x9, 0x6, 0x7, 0xF]] = [0, 1, 0, 1, 8, 10, 14, 15, 15]
"""The type of EVT2 for each of EVT4; 2 is unknown to both."""
_TYPES = np.zeros(16, np.uint32)
_TYPES[[evt2.OFF, evt2.ON, evt2.TIME_HIGH, evt2.TRIGGER]] = [0xA, 0xB, 0xE, 0x9]

_TIMED, _OPEN = 0, 6
"""Places in the state vector: a TIME_HIGH has come; the vector whose mask has not, 0 for none."""


class Decoder(evt21.Decoder):
    """EVT4 words to events. See `evis.events.codecs.decoder.Decoder`."""

    encoding = "evt4"
    word: ClassVar[np.dtype[Any]] = np.dtype("<u4")
    state_size = 7
    kernel = "evis.events.codecs.prophesee.evt4_kernels:decode_evt4"

    def _begin(self) -> None:
        self.state[_OPEN] = 0

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """The vectorised reference: each event, vector or other word as a word of EVT2.1."""
        if not len(words):
            return Events.empty(), 0, -1
        opened = int(self.state[_OPEN])
        is_vector = (words >> 29) == _VECTOR_OFF >> 1
        is_vector[: bool(opened)] = False
        # words in a row that look like vectors are vectors and their masks by turns
        places = np.arange(len(words))
        first = np.maximum.accumulate(np.where(is_vector & ~np.append(False, is_vector[:-1]), places, -1))
        is_vector &= (places - first) % 2 == 0
        is_mask = np.append(bool(opened), is_vector[:-1])
        masks = np.append(words[1:], 0)
        single = (words >> 29) == 0xA >> 1
        lower = np.where(is_vector, masks, single)[~is_mask]
        at, upper = places[~is_mask], words[~is_mask]
        if opened and self.state[_TIMED] > 0:  # one without a time was counted with its first word
            at, upper = np.append(0, at), np.append(np.uint32(opened), upper)
            lower = np.append(words[0], lower)
        upper = _AS_EVT2[upper >> 28] << 28 | upper & 0xFFFFFFF
        units = upper.astype(np.uint64) << np.uint64(32) | lower.astype(np.uint64)
        events, used, following = super().decode_words(units, limit)
        if used == len(units):
            self.state[_OPEN] = int(words[-1]) if is_vector[-1] else 0
            return events, len(words), following
        if used:
            self.state[_OPEN] = 0
        return events, int(at[used]), following


class Encoder(evt21.Encoder):
    """Events to EVT4: neighbours as in EVT2.1 share a vector, others have a word each."""

    encoding = "evt4"
    word: ClassVar[np.dtype[Any]] = np.dtype("<u4")

    def _pack(self, words: np.ndarray) -> bytes:
        words = words.astype(np.uint64)
        upper, mask = (words >> np.uint64(32)).astype(np.uint32), words.astype(np.uint32)
        kind = upper >> 28
        event = kind <= evt2.ON
        several = event & (mask & mask - (mask > 0) != 0)
        column = np.log2(np.maximum(mask, 1)).astype(np.uint32)
        first = (_TYPES[kind] + 2 * several) << 28 | upper & 0xFFFFFFF
        first += np.where(event & ~several, column << 11, 0).astype(np.uint32)
        pairs = np.stack([first, mask], axis=1)
        return pairs[np.stack([np.ones(len(first), bool), several], axis=1)].astype(self.word).tobytes()
