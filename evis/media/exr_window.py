"""Puts the pixels of an OpenEXR file where they are in its picture, which is the display window.

The data window says which part of the plane is stored: less than the picture where a program leaves out what is black,
more where it renders beyond the border (Technical Introduction to OpenEXR, "Basic Definitions").
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

DATA, DISPLAY = "dataWindow", "displayWindow"


def sides(header: Mapping[str, Any], window: str) -> tuple[int, int]:
    """Returns width and height of a window of a header [px], 0 for one turned inside out."""
    low, high = header[window]
    width, height = (max(int(b) - int(a) + 1, 0) for a, b in zip(low, high))
    return width, height


def displayed(pixels: np.ndarray, header: Mapping[str, Any]) -> np.ndarray:
    """Returns the picture, [height, width, ...] of the display window, from `pixels` of the data window.

    What is not stored is 0, what lies beyond the picture is left out. Pixels of equal windows come as they are.
    """
    (left, top), (x, y) = ((int(v) for v in header[window][0]) for window in (DATA, DISPLAY))
    left, top = left - x, top - y
    width, height = sides(header, DISPLAY)
    rows, columns = pixels.shape[:2]
    if (left, top, columns, rows) == (0, 0, width, height):
        return pixels
    picture = np.zeros((height, width, *pixels.shape[2:]), pixels.dtype)
    stored = pixels[max(-top, 0) : max(height - top, 0), max(-left, 0) : max(width - left, 0)]
    top, left = max(top, 0), max(left, 0)
    picture[top : top + stored.shape[0], left : left + stored.shape[1]] = stored
    return picture
