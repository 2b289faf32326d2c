"""The 8-bit picture of a keyframe that goes into every bag, for people."""

from __future__ import annotations

import numpy as np

from evis.media.colour import REC709, srgb_from_linear

LEVELS = 4096
_TABLE: list[np.ndarray] = []


def _curve() -> np.ndarray:
    """uint8 [LEVELS + 1]: compressed radiance x/(1+x) in steps of 1/LEVELS -> sRGB code (IEC 61966-2-1)."""
    if not _TABLE:
        u = np.arange(LEVELS + 1) / LEVELS
        _TABLE.append(np.round(255 * srgb_from_linear(u)).astype(np.uint8))
    return _TABLE[0]


def exposure(radiance: np.ndarray) -> float:
    """Computes the gain that brings the image's log-average luminance to middle grey, 0.18 (Reinhard et al. 2002, eq.
    1-2).

    radiance: [..., 3], linear. Black, negative and non-finite pixels do not count; 1.0 where nothing else is there.
    A grid of at most about 10 000 pixels is looked at.
    """
    flat = radiance.reshape(-1, 3)
    sample = flat[:: max(1, len(flat) // 10_000)].astype(np.float64)
    luminance = sample @ np.array(REC709)
    lit = luminance[np.isfinite(luminance) & (luminance > 0)]
    return float(0.18 / np.exp(np.log(lit).mean())) if len(lit) else 1.0


def tone_map(radiance: np.ndarray, gain: float | None = None) -> np.ndarray:
    """Maps linear radiance [..., 3] to sRGB uint8 [..., 3]: gain, then x/(1+x) per channel (Reinhard et al. 2002, eq.
    3).

    gain None = `exposure(radiance)`. NaN is black, +inf white.
    """
    x = np.maximum(radiance.astype(np.float32) * np.float32(exposure(radiance) if gain is None else gain), 0)
    with np.errstate(invalid="ignore", over="ignore"):
        u = 1 - 1 / (1 + x)
    np.nan_to_num(u, copy=False, nan=0.0)
    return _curve()[(u * LEVELS + 0.5).astype(np.int32)]
