"""Inverts tone curves: from the codes of an 8 or 16 bit image to linear radiance."""

from __future__ import annotations

import math

import numpy as np

from evis.media.colour import REC709, linear_from_srgb

TONES = "srgb, linear or gamma:G"


class Tone:
    """Turns codes of an image into radiance by a curve: `srgb` (IEC 61966-2-1), `linear`, or `gamma:G` (radiance = code
    ** G). white: full scale.

    Raises ValueError for an unknown curve or a value out of range.
    """

    def __init__(self, name: str, white: float = 1.0) -> None:
        kind, _, text = name.strip().lower().partition(":")
        self._gamma = {"srgb": 0.0, "linear": 1.0}.get(kind)
        if kind == "gamma":
            try:
                self._gamma = float(text)
            except ValueError:
                raise ValueError(f"tone is '{name}': after gamma: comes a number, as gamma:2.2") from None
            if not 0.1 <= self._gamma <= 10:
                raise ValueError(f"tone is '{name}', gamma must be 0.1 to 10")
        if self._gamma is None or (text and kind != "gamma"):
            raise ValueError(f"tone is '{name}', must be {TONES}")
        if not (math.isfinite(white) and 0 < white <= 1e30):
            raise ValueError(f"white is {white:g}, must be the radiance of full scale, above 0")
        self.name, self.white = name, white
        self._tables: dict[int, np.ndarray] = {}

    def decode(self, code: np.ndarray) -> np.ndarray:
        """Computes the radiance of codes in 0 to 1, float64."""
        if self._gamma:
            return self.white * np.power(code, self._gamma)
        return self.white * linear_from_srgb(code)

    def _table(self, dtype: np.dtype) -> np.ndarray:
        """float32 [4, codes]: radiance of every code, and its shares of luminance as R, G and B."""
        codes = np.iinfo(dtype).max + 1
        if codes not in self._tables:
            radiance = self.decode(np.arange(codes) / (codes - 1))
            self._tables[codes] = np.outer((1.0, *REC709), radiance).astype(np.float32)
        return self._tables[codes]

    def radiance(self, image: np.ndarray) -> np.ndarray:
        """Converts codes, uint8 or uint16 [...], to linear light, float32 of the same shape."""
        return self._table(image.dtype)[0][image]

    def luminance(self, image: np.ndarray) -> np.ndarray:
        """Converts codes, uint8 or uint16 [H, W] or [H, W, 3], to linear luminance, float32 [H, W]."""
        if image.ndim == 2:
            return self.radiance(image)
        _, r, g, b = self._table(image.dtype)
        return r[image[..., 0]] + g[image[..., 1]] + b[image[..., 2]]


def shaped(image: np.ndarray, tone: Tone, colour: bool) -> np.ndarray:
    """Converts codes [H, W] or [H, W, 3] as linear luminance [H, W] or RGB [H, W, 3]."""
    if not colour:
        return tone.luminance(image)
    radiance = tone.radiance(image)
    return np.repeat(radiance[..., None], 3, axis=2) if radiance.ndim == 2 else radiance
