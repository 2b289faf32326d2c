"""Encodes flow in 16 bit PNG, as DSEC has it (uzh-rpg/DSEC, scripts/check_optical_flow_submission.py:
flow_16bit_to_float)."""

from __future__ import annotations

import numpy as np

SCALE, ZERO = 128.0, 1 << 15


def flow_to_codes(flow: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Returns uint16 [H, W, 3] of displacements [H, W, 2] px: 128 x + 2^15, 128 y + 2^15, and 1 where it is valid.

    What is not finite or does not fit, below -256 px or from 256 px on, is not valid.
    """
    with np.errstate(invalid="ignore"):
        codes = np.rint(flow * np.float32(SCALE)) + np.float32(ZERO)  # a power of two: exact in float32 too
        inside = (codes >= 0) & (codes < 1 << 16)
    known = (valid > 0) & inside[..., 0] & inside[..., 1]
    codes[~known] = ZERO
    out = np.empty((*known.shape, 3), np.uint16)
    out[..., :2], out[..., 2] = codes, known
    return out


def codes_to_flow(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns displacements float32 [H, W, 2] px, NaN where not valid, and uint8 [H, W], 1 where valid."""
    valid = codes[..., 2] == 1
    flow = (codes[..., :2].astype(np.float64) - ZERO) / SCALE
    return np.where(valid[..., None], flow, np.nan).astype(np.float32), valid.astype(np.uint8)
