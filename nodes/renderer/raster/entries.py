"""Unpacks entries of the z-buffer on the host; depth_kernels has what a kernel reads of them."""

from __future__ import annotations

import numpy as np

from nodes.renderer.raster.depth_kernels import BACK


def triangles_of(packed: np.ndarray) -> np.ndarray:
    """Gives the triangle int32 of each entry uint64, whichever side of it is seen; -1 where there is none."""
    faces = (packed & np.uint64(0xFFFFFFFF)).astype(np.uint32).view(np.int32)
    return np.where(faces < 0, -1, faces & (int(BACK) - 1)).astype(np.int32)
