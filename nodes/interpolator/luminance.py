"""Luminance of a keyframe, equation (3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator import kernels


def luminance_of(radiance: np.ndarray, device: Any = "cpu") -> wp.array:
    """float32 [...] Rec. 709 luminance of linear radiance [..., 3] in float32 or float16, on the device."""
    pixels: wp.array = wp.array(radiance.reshape(-1, 3), device=device, copy=False)
    image = wp.empty(radiance.shape[:-1], dtype=wp.float32, device=device)
    wp.launch(kernels.luminance, pixels.shape[0], [pixels], [image.flatten()], device=device)
    return image
