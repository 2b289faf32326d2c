"""Converts display colours to linear light."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from evis.media import colour


def linear_from_srgb(value: np.ndarray) -> np.ndarray:
    """Converts display values within [0, 1] to linear light, float32 (IEC 61966-2-1)."""
    return colour.linear_from_srgb(np.asarray(value, np.float64)).astype(np.float32)


@lru_cache
def _linear(codes: int) -> np.ndarray:
    return linear_from_srgb(np.arange(codes) / (codes - 1))


def linear_from_codes(image: np.ndarray) -> np.ndarray:
    """Converts display values of 8 or 16 bits, uint8 or uint16 of any shape, to linear light, float32."""
    return _linear(np.iinfo(image.dtype).max + 1)[image]
