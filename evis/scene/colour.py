"""Display colours as linear light."""

from __future__ import annotations

import numpy as np

from evis.media import colour


def linear_from_srgb(value: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1: display values within [0, 1] as linear light, float32."""
    return colour.linear_from_srgb(np.asarray(value, np.float64)).astype(np.float32)


_BYTES = linear_from_srgb(np.arange(256) / 255)


def linear_from_bytes(image: np.ndarray) -> np.ndarray:
    """The same of 8-bit values, any shape."""
    return _BYTES[np.asarray(image, np.uint8)]
