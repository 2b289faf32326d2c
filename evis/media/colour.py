"""Converts colours of light: the sRGB curve both ways, and luminance by the primaries of Rec. 709.

Plain numbers and numpy, so that kernels take the weights as constants and nobody loads Warp for them.
"""

from __future__ import annotations

import numpy as np

REC709 = (0.2126, 0.7152, 0.0722)
"""Weights of linear R, G and B in luminance (ITU-R BT.709), equation (3)."""


def linear_from_srgb(code: np.ndarray) -> np.ndarray:
    """Converts display values within [0, 1], float64 of any shape, to linear light (IEC 61966-2-1)."""
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    """Converts linear light within [0, 1], float of any shape, to display values within [0, 1] (IEC 61966-2-1)."""
    low = linear * 12.92
    high = 1.055 * np.power(np.maximum(linear, 1e-9), 1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, low, high)


def luminance_of(rgb: np.ndarray) -> np.ndarray:
    """Computes the luminance of linear RGB [..., 3] as float32 [...], each product and sum rounded once.

    So do the kernels of a graph. A product of matrices would sum as a processor, and a pixel's place in the array, have
    it: the same picture, cut into other blocks or mirrored, would have other bits.
    """
    rgb = rgb.astype(np.float32, copy=False)
    red, green, blue = (np.float32(weight) for weight in REC709)
    luminance: np.ndarray = rgb[..., 0] * red
    luminance += rgb[..., 1] * green
    luminance += rgb[..., 2] * blue
    return luminance
