"""Display colours as linear light."""

from __future__ import annotations

import numpy as np

from evis.media import colour


def linear_from_srgb(value: np.ndarray) -> np.ndarray:
    """Converts display values within [0, 1] to linear light, float32 (IEC 61966-2-1)."""
    return colour.linear_from_srgb(np.asarray(value, np.float64)).astype(np.float32)


_BYTES = linear_from_srgb(np.arange(256) / 255)


def linear_from_bytes(image: np.ndarray) -> np.ndarray:
    """Converts 8-bit display values of any shape to linear light, float32."""
    return _BYTES[np.asarray(image, np.uint8)]
