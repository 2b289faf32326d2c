"""Inverts tone curves: from the codes of an 8 or 16 bit image to linear radiance.

`pq` and `hlg` are the curves of high dynamic range that telephones and cameras film with (ITU-R BT.2100, tables 4, 5).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from evis.media.colour import REC709, linear_from_srgb

TONES = "srgb, linear, gamma:G, pq or hlg"
REC2020 = (0.2627, 0.6780, 0.0593)
"""Weights of linear R, G and B in luminance (ITU-R BT.2020)."""
DARK_SHARE = {"pq": 2e-4}
"""Curve -> a dark level about as large as its coarse steps, as a share of full scale; 0.01 of others. PQ goes to 10,000
cd/m2, of which white paper has about 203 (ITU-R BT.2408)."""


def linear_from_pq(code: np.ndarray) -> np.ndarray:
    """Converts PQ codes within [0, 1], float64 of any shape, to light of the display, 1 = 10,000 cd/m2 (BT.2100)."""
    root = np.power(code, 32 / 2523)
    return np.power(np.maximum(root - 3424 / 4096, 0) / (2413 / 128 - 2392 / 128 * root), 16384 / 2610)


def linear_from_hlg(code: np.ndarray) -> np.ndarray:
    """Converts HLG codes within [0, 1], float64 of any shape, to light of the scene within [0, 1] (BT.2100)."""
    a = 0.17883277
    b, c = 1 - 4 * a, 0.5 - a * math.log(4 * a)
    return np.where(code <= 0.5, code**2 / 3, (np.exp((code - c) / a) + b) / 12)


CURVES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "srgb": linear_from_srgb, "linear": np.positive, "pq": linear_from_pq, "hlg": linear_from_hlg
}  # fmt: skip


class Tone:
    """Turns codes of an image into radiance by a curve: `srgb` (IEC 61966-2-1), `linear`, `gamma:G` (radiance = code
    ** G), `pq` or `hlg`. white: full scale. weights: of R, G and B in luminance.

    Raises ValueError for an unknown curve or a value out of range.
    """

    def __init__(self, name: str, white: float = 1.0, weights: tuple[float, float, float] = REC709) -> None:
        kind, _, text = name.strip().lower().partition(":")
        self._gamma = 1.0
        if kind == "gamma":
            try:
                self._gamma = float(text)
            except ValueError:
                raise ValueError(f"tone is '{name}': after gamma: comes a number, as gamma:2.2") from None
            if not 0.1 <= self._gamma <= 10:
                raise ValueError(f"tone is '{name}', gamma must be 0.1 to 10")
        elif kind not in CURVES or text:
            raise ValueError(f"tone is '{name}', must be {TONES}")
        if not (math.isfinite(white) and 0 < white <= 1e30):
            raise ValueError(f"white is {white:g}, must be the radiance of full scale, above 0")
        self.name, self.white = name, white
        self._kind, self._weights = kind, weights
        self._tables: dict[tuple[int, int], np.ndarray] = {}

    @property
    def dark_level(self) -> float:
        """Returns a dark level to propose for such codes, in the unit of `white`."""
        return DARK_SHARE.get(self._kind, 0.01) * self.white

    def decode(self, code: np.ndarray) -> np.ndarray:
        """Computes the radiance of codes in 0 to 1, float64."""
        curve = CURVES.get(self._kind)
        return self.white * (np.power(code, self._gamma) if curve is None else curve(code))

    def _table(self, dtype: np.dtype, white: int | None) -> np.ndarray:
        """float32 [4, codes]: radiance of every code, and its shares of luminance as R, G and B."""
        most = int(np.iinfo(dtype).max)
        key = most, most if white is None else white
        if key not in self._tables:
            # what is brighter than white is cut off there
            radiance = self.decode(np.minimum(np.arange(most + 1) / key[1], 1))
            self._tables[key] = np.outer((1.0, *self._weights), radiance).astype(np.float32)
        return self._tables[key]

    def radiance(self, image: np.ndarray, white: int | None = None) -> np.ndarray:
        """Converts codes, uint8 or uint16 [...], to linear light, float32 of the same shape. white: the code of full
        scale, None = the largest one."""
        return self._table(image.dtype, white)[0][image]

    def luminance(self, image: np.ndarray, white: int | None = None) -> np.ndarray:
        """Converts codes, uint8 or uint16 [H, W] or [H, W, 3], to linear luminance, float32 [H, W]. white: as of
        `radiance`."""
        if image.ndim == 2:
            return self.radiance(image, white)
        _, r, g, b = self._table(image.dtype, white)
        return r[image[..., 0]] + g[image[..., 1]] + b[image[..., 2]]


def shaped(image: np.ndarray, tone: Tone, colour: bool, white: int | None = None) -> np.ndarray:
    """Converts codes [H, W] or [H, W, 3] as linear luminance [H, W] or RGB [H, W, 3]. white: as of Tone.radiance."""
    if not colour:
        return tone.luminance(image, white)
    radiance = tone.radiance(image, white)
    return np.repeat(radiance[..., None], 3, axis=2) if radiance.ndim == 2 else radiance
