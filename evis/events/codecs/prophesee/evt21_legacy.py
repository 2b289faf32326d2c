"""Decodes and encodes EVT2.1 as the IMX636 sends it: the upper 32 bits of each word come first."""

from __future__ import annotations

import numpy as np

from evis.events.codecs.prophesee import evt21


def _swapped(words: np.ndarray) -> np.ndarray:
    return words >> np.uint64(32) | words << np.uint64(32)


class Decoder(evt21.Decoder):
    """Decodes EVT2.1 words in legacy order to events."""

    encoding = "evt21_legacy"

    def _view(self, words: np.ndarray) -> np.ndarray:
        return _swapped(words)


class Encoder(evt21.Encoder):
    """Encodes events as EVT2.1 words in legacy order."""

    encoding = "evt21_legacy"

    def _pack(self, words: np.ndarray) -> bytes:
        return _swapped(words.astype(self.word)).tobytes()
