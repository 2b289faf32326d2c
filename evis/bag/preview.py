"""Makes the 8-bit picture of a keyframe that goes into every bag, for people."""

from __future__ import annotations

import numpy as np

from evis.bag.threads import ALONE, Threads
from evis.media.colour import REC709, srgb_from_linear

LEVELS = 4096
_BLOCK = 1 << 17
"""Numbers that are mapped at a time: what is between two steps stays in the cache."""
_TABLE: list[np.ndarray] = []


def _srgb_table() -> np.ndarray:
    """Tabulates the sRGB code (IEC 61966-2-1) of compressed radiance x/(1+x) in steps of 1/LEVELS: uint8
    [LEVELS + 1]."""
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


def tone_map(radiance: np.ndarray, gain: float | None = None, threads: Threads = ALONE) -> np.ndarray:
    """Maps linear radiance [..., 3] to sRGB uint8 [..., 3]: gain, then x/(1+x) per channel (Reinhard et al. 2002, eq.
    3).

    gain None = `exposure(radiance)`. NaN is black, +inf white. threads: share the rows.
    """
    scale, curve = np.float32(exposure(radiance) if gain is None else gain), _srgb_table()
    picture = np.empty(radiance.shape, np.uint8)
    rows = max(1, _BLOCK // max(1, radiance[:1].size))

    def develop(first: int) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            u = radiance[first : first + rows].astype(np.float32)
            u *= scale
            np.fmax(u, 0, out=u)  # of NaN and 0 it is 0
            u += 1
            np.divide(1, u, out=u)
            np.subtract(1, u, out=u)
            u *= LEVELS
            u += 0.5
            # None is beyond the curve; any mode but the usual one lets it write where it is to be.
            curve.take(u.astype(np.int32), out=picture[first : first + rows], mode="clip")

    threads.map(develop, range(0, len(radiance), rows))
    return picture
