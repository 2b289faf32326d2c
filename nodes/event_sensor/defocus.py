"""Defocus: a separable Gaussian on linear intensity, before the logarithm."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from nodes.event_sensor import kernels

REACH = 4.0
"""Filter radius in standard deviations; the weight cut off is 6e-5."""


class Defocus:
    """Blur with standard deviation sigma [px]; edges are repeated, so a constant image stays as it is."""

    def __init__(self, sigma: float, device: str) -> None:
        radius = max(1, math.ceil(REACH * sigma))
        weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
        self._weights: wp.array = wp.array((weights / weights.sum()).astype(np.float32), device=device)
        self._buffers: tuple[wp.array, wp.array] | None = None
        self._device = device

    def __call__(self, images: wp.array) -> wp.array:
        """float32 [N, H, W, C] -> the same, blurred, in a buffer that the next call overwrites."""
        if self._buffers is None or self._buffers[0].shape != images.shape:
            self._buffers = (
                wp.empty(images.shape, dtype=wp.float32, device=self._device),
                wp.empty(images.shape, dtype=wp.float32, device=self._device),
            )
        rows, both = self._buffers
        wp.launch(kernels.blur, images.shape, [self._weights, images, 2], [rows], device=self._device)
        wp.launch(kernels.blur, images.shape, [self._weights, rows, 1], [both], device=self._device)
        return both
