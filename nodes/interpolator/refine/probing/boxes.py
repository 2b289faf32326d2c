"""Gathers the boxes about instances, on the host, where the poses of their bodies are."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator.refine.probing.box_kernels import Boxes
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import half_extents


def boxes_of(
    visibility: Visibility, movers: np.ndarray, which: np.ndarray, fine: np.ndarray | None = None
) -> tuple[Any, int]:
    """Makes Boxes of some instances, on the host, where the poses are, and tells how many there are. fine: of all
    instances, float64 [I, 3] m, where it is asked for."""
    geometry, boxes = visibility.geometry, Boxes()
    with wp.ScopedDevice("cpu"):
        boxes.mover = wp.array(np.searchsorted(movers, geometry.body[which]).astype(np.int32), dtype=wp.int32)
        boxes.rotation = wp.array(geometry.rotation[which], dtype=wp.mat33d)
        boxes.translation = wp.array(geometry.translation[which], dtype=wp.vec3d)
        boxes.half = wp.array(half_extents(visibility)[which], dtype=wp.vec3d)
        if fine is not None:
            boxes.fine = wp.array(fine[which], dtype=wp.vec3d)
    return boxes, len(which)
