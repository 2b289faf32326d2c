"""Makes R, G and B of the luminance and chroma that an EXR file may have in their place: Y, RY and BY.

    Y = w_R R + w_G G + w_B B,   RY = (R - Y) / Y,   BY = (B - Y) / Y,

the weights being those of the file's primaries. Chroma mostly has every second pixel and row; what lies between is made
by the windowed sinc of 27 taps of which those at even distances are 0. Colours that chroma overshoots into where it
changes are taken back to about the saturation around them, as all readers of the definition do, which also leaves none
below 0. Source: OpenEXR, ImfRgbaYca.h and its program, and "Technical Introduction to OpenEXR", "Luminance/Chroma".
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

CHROMA = ("RY", "BY")
"""Names of the channels beside Y."""
REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""Primaries and white, x and y each, of a file that says nothing."""
TAPS = (0.002128, -0.00754, 0.019597, -0.043159, 0.087929, -0.186077, 0.627123)
"""Of samples at -13, -11, ... -1 pixels, and of those at 13, 11, ... 1."""
LEFT_OF_SATURATION = 0.25
"""What a pixel must keep of the distance of its neighbours' saturation from 1."""


def luminance_weights(chromaticities: Sequence[float]) -> np.ndarray:
    """Computes float64 [3], the shares of R, G and B in the luminance of white.

    chromaticities: x, y of red, green, blue and white. Raises ValueError for primaries that span no colours.
    """
    xy = np.asarray(chromaticities, np.float64).reshape(4, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        xyz = np.column_stack([xy[:, 0] / xy[:, 1], np.ones(4), (1 - xy.sum(axis=1)) / xy[:, 1]])
    if not np.isfinite(xyz).all() or abs(np.linalg.det(xyz[:3])) < 1e-9:
        raise ValueError("its chromaticities span no colours")
    return np.linalg.solve(xyz[:3].T, xyz[3])


def rgb_of(y: np.ndarray, ry: np.ndarray, by: np.ndarray, chromaticities: Sequence[float]) -> np.ndarray:
    """Computes float32 [h, w, 3] of luminance [h, w] and chroma of its size, or of half of it. Raises ValueError."""
    weights = luminance_weights(chromaticities).astype(np.float32)
    light = y.astype(np.float32)
    red, blue = ((_whole(chroma.astype(np.float32), (len(y), y.shape[1])) + 1) * light for chroma in (ry, by))
    green = (light - red * weights[0] - blue * weights[2]) / weights[1]
    return _less_saturated(np.stack([red, green, blue], axis=-1), weights)


def _whole(chroma: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Chroma at every pixel of an image [h, w]. Raises ValueError for sizes that do not go together."""
    for axis in (0, 1):
        if chroma.shape[axis] == shape[axis]:
            continue
        if chroma.shape[axis] != -(-shape[axis] // 2):
            (h, w), (rows, columns) = chroma.shape, shape
            raise ValueError(f"its chroma is {w}x{h} and its luminance {columns}x{rows} pixels, and not twice as many")
        chroma = np.moveaxis(_between(np.moveaxis(chroma, axis, 0), shape[axis]), 0, axis)
    return chroma


def _between(samples: np.ndarray, length: int) -> np.ndarray:
    """Samples [n, ...] and what lies between two of them, [length, ...]; beyond the ends the last ones go on."""
    count, taps = len(samples), len(TAPS)
    padded = np.pad(samples, [(taps - 1, taps), *[(0, 0)] * (samples.ndim - 1)], mode="edge")
    result = np.empty((2 * count, *samples.shape[1:]), np.float32)
    result[0::2] = samples
    pairs = ((padded[k : k + count], padded[2 * taps - 1 - k :][:count]) for k in range(taps))
    result[1::2] = sum(np.float32(tap) * (a + b) for tap, (a, b) in zip(TAPS, pairs, strict=True))
    return result[:length]


def _less_saturated(rgb: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Brings pixels that are much more saturated than their four diagonal neighbours nearer to grey, at the same
    luminance."""
    most = rgb.max(axis=-1)
    lit = most > 0
    saturation = np.where(lit, 1 - rgb.min(axis=-1) / np.where(lit, most, 1), 0)
    around = np.pad(saturation, 1, mode="edge")
    mean = (around[:-2, :-2] + around[:-2, 2:] + around[2:, :-2] + around[2:, 2:]) / 4
    limit = 1 - (1 - np.minimum(mean, 1)) * LEFT_OF_SATURATION
    beyond = (saturation > mean) & (saturation > limit)
    if not beyond.any():
        return rgb
    found, top = rgb[beyond], most[beyond][:, None]
    share = (limit[beyond] / saturation[beyond])[:, None]
    nearer = np.maximum(top - (top - found) * share, 0)
    before, after = found @ weights, nearer @ weights
    rgb[beyond] = nearer * np.where(after > 0, before / np.where(after > 0, after, 1), 1)[:, None]
    return rgb
