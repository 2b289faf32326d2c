"""Computes boxes of what a camera sees, of images of ids."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.warp_start import start_warp
from nodes.labeler.images import image_label_kernels as kernels

start_warp()


def crop(image: Any, margin: int) -> Any:
    """Leaves out the margin of images [E, H + 2 margin, W + 2 margin, ...], numpy's or Warp's, as a view."""
    return image[:, margin:-margin, margin:-margin] if margin else image


def boxes(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the visible extent of every instance in ids int32 [E, H, W], the background left out.

    Returns float32 [B, 4] (x0, y0, x1, y1, inclusive pixels), int32 [B] environment and int32 [B] id, by environment
    and then id.
    """
    count = int(ids.max(initial=0)) + 1
    least = np.full((len(ids), count, 2), np.iinfo(np.int32).max, np.int32)
    most = np.full_like(least, -1)
    if ids.size:
        given = _array(np.ascontiguousarray(ids), wp.int32)
        found = [_array(least, wp.int32), _array(most, wp.int32)]
        wp.launch(kernels.extents, ids.shape[:2], [given], found, device="cpu")
    env, number = np.nonzero(most[:, 1:, 0] >= 0)
    box = np.concatenate((least[env, number + 1], most[env, number + 1]), axis=1).astype(np.float32)
    return box, env.astype(np.int32), (number + 1).astype(np.int32)


def _array(values: np.ndarray, dtype: Any) -> wp.array:
    """Gives the same memory to a kernel, with its strides."""
    return wp.array(values, dtype=dtype, device="cpu", copy=False)
