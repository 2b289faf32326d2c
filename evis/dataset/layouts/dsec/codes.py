"""DSEC's numbers in PNG files.

Flow is that of `flow_16bit_to_float` in uzh-rpg/DSEC, scripts/check_optical_flow_submission.py; disparity that of
`Sequence.get_disparity_map` in scripts/dataset/sequence.py.
"""

from __future__ import annotations

import numpy as np

FLOW_SCALE, FLOW_ZERO = 128.0, 1 << 15
DISPARITY_SCALE = 256.0


def flow_to_codes(flow: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Returns uint16 [H, W, 3] of displacements [H, W, 2] px: 128 x + 2^15, 128 y + 2^15, and 1 where it is valid.

    What is not finite or does not fit, below -256 px or from 256 px on, is not valid.
    """
    with np.errstate(invalid="ignore"):
        codes = np.rint(flow.astype(np.float64) * FLOW_SCALE) + FLOW_ZERO
        known = (valid > 0) & ((codes >= 0) & (codes < 1 << 16)).all(-1)
    both = np.where(known[..., None], codes, FLOW_ZERO)
    return np.concatenate((both, known[..., None]), -1).astype(np.uint16)


def codes_to_flow(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns displacements float32 [H, W, 2] px, NaN where not valid, and uint8 [H, W], 1 where valid."""
    valid = codes[..., 2] == 1
    flow = (codes[..., :2].astype(np.float64) - FLOW_ZERO) / FLOW_SCALE
    return np.where(valid[..., None], flow, np.nan).astype(np.float32), valid.astype(np.uint8)


def disparity_to_codes(depth: np.ndarray, focal_baseline: float) -> np.ndarray:
    """Returns uint16 [H, W], disparity times 256, 0 = unknown, of depths [H, W] m.

    focal_baseline: product of focal length and baseline [px m].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        codes = np.rint(focal_baseline / depth.astype(np.float64) * DISPARITY_SCALE)
    return np.where((codes > 0) & (codes < 1 << 16), codes, 0).astype(np.uint16)


def codes_to_disparity(codes: np.ndarray) -> np.ndarray:
    """Returns disparities float32 [H, W] px, NaN where unknown."""
    return np.where(codes > 0, codes / DISPARITY_SCALE, np.nan).astype(np.float32)
