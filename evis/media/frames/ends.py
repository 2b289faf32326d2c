"""Counts pixels at the ends of a code: black or at full scale, where an image does not tell how much light there
was."""

from __future__ import annotations

import numpy as np

BLACK, FULL = 1, 2
"""Bits of a pixel's flag: every channel is code 0; some channel is the largest code."""


def ends_of(codes: np.ndarray, white: int | None = None) -> np.ndarray:
    """Flags the pixels at an end of the code.

    Args:
        codes: uint8 or uint16 [H, W] or [H, W, 3].
        white: the code of full scale, None = the largest one.

    Returns:
        uint8 [H, W], BLACK, FULL or 0.
    """
    flags = (codes != 0).view(np.uint8)
    flags |= (codes >= (np.iinfo(codes.dtype).max if white is None else white)).view(np.uint8) << 1
    if codes.ndim == 3:
        flags = flags[..., 0] | flags[..., 1] | flags[..., 2]
    flags ^= BLACK  # until here that bit says that a pixel is lit
    return flags


def end_counts(ends: np.ndarray) -> tuple[int, int, int]:
    """Counts the pixels of flags uint8 [...] of `ends_of`: all, black ones, those at full scale."""
    return ends.size, int(np.count_nonzero(ends & BLACK)), int(np.count_nonzero(ends & FULL))
