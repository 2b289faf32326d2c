"""Finds the picture among the channels of an EXR file, for frames and for what surfaces and skies are made of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

PICTURES = ("RGB", "RGBA", "Y", "YA")
"""As OpenEXR joins the channels of a picture, in colour or grey; Z, ids and others stand beside it."""


def picture_of(channels: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Gives the picture of half or float, [h, w] or [h, w, channels]; None where there is none."""
    pixels = next((channels[name] for name in PICTURES if name in channels), None)
    return None if pixels is None or pixels.dtype.kind != "f" else pixels
