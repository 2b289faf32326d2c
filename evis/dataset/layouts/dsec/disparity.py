"""Encodes DSEC's disparity in 16 bit PNG: `Sequence.get_disparity_map` in uzh-rpg/DSEC, scripts/dataset/sequence.py."""

from __future__ import annotations

import numpy as np

SCALE = 256.0


def disparity_to_codes(depth: np.ndarray, focal_baseline: float) -> np.ndarray:
    """Returns uint16 [H, W], disparity times 256, 0 = unknown, of depths [H, W] m.

    focal_baseline: product of focal length and baseline [px m].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        codes = np.rint(focal_baseline / depth.astype(np.float64) * SCALE)
    return np.where((codes > 0) & (codes < 1 << 16), codes, 0).astype(np.uint16)


def codes_to_disparity(codes: np.ndarray) -> np.ndarray:
    """Returns disparities float32 [H, W] px, NaN where unknown."""
    return np.where(codes > 0, codes / SCALE, np.nan).astype(np.float32)
