"""Computes defocus: a separable Gaussian on linear intensity, before the logarithm, and the lens that it stands for."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from nodes.event_sensor.optics import defocus_kernels as kernels

REACH = 4.0
"""Filter radius in standard deviations; the weight cut off is 6e-5."""


def defocus_from_optics(
    focal_length_m: float,
    f_number: float,
    focus_distance_m: float,
    pixel_pitch_m: float,
    depth_m: float | np.ndarray,
) -> float | np.ndarray:
    """Returns the standard deviation [px] of the blur of what lies at `depth_m`, a number or an array of any shape.

    A thin lens of aperture f / N focused at s makes of a point at depth d a disc, the circle of confusion, of diameter
    c = f^2 / N |1/d - 1/s| / (1 - f / s) (Potmesil and Chakravarty, SIGGRAPH 1981). The Gaussian has the disc's second
    moment: a uniform disc of diameter c has the standard deviation c / 4 along each axis. Distances from the lens [m],
    inf allowed for both; the focal length [m]; f_number N, inf for a pinhole. Diffraction is left out: the Gaussian of
    an Airy disc has 0.42 wavelengths times N, half a pixel of 4.86 um at N = 11. Raises ValueError.
    """
    for name, value, least in (
        ("focal_length_m", focal_length_m, 0.0),
        ("f_number", f_number, 0.0),
        ("pixel_pitch_m", pixel_pitch_m, 0.0),
        ("focus_distance_m", focus_distance_m, focal_length_m),
    ):
        if not value > least:
            raise ValueError(f"{name} is {value:g}, must be above {least:g}")
    if not (math.isfinite(focal_length_m) and math.isfinite(pixel_pitch_m)):
        raise ValueError(f"focal_length_m {focal_length_m:g} and pixel_pitch_m {pixel_pitch_m:g} must be finite")
    depth = np.asarray(depth_m, np.float64)
    if not np.all(depth > 0):
        raise ValueError("depth_m must be above 0 everywhere")
    vergence = np.abs(1.0 / depth - 1.0 / focus_distance_m) / (1.0 - focal_length_m / focus_distance_m)
    sigma = focal_length_m**2 / f_number * vergence / (4.0 * pixel_pitch_m)
    return sigma if sigma.ndim else float(sigma)


class Defocus:
    """Blurs images with the standard deviation sigma [px]; edges are repeated, so a constant image stays as it is."""

    def __init__(self, sigma: float, device: str) -> None:
        radius = max(1, math.ceil(REACH * sigma))
        weights = np.exp(-0.5 * (np.arange(radius + 1) / sigma) ** 2)
        weights /= weights[0] + 2.0 * weights[1:].sum()
        self._weights: wp.array = wp.array(weights.astype(np.float32), device=device)
        self._blurred: wp.array | None = None
        self._rows: wp.array = wp.empty(0, dtype=wp.float32, device=device)
        self._device = wp.get_device(device)

    def __call__(self, images: wp.array) -> wp.array:
        """Blurs images float32 [N, H, W, C], in a buffer that the next call overwrites."""
        count, height, width, channels = images.shape
        row = width * channels
        ring = 2 * len(self._weights) - 1
        if self._blurred is None or self._blurred.shape != images.shape:
            # On a GPU whole images between the two passes, on a CPU the rows that the next one needs.
            room = images.size if self._device.is_cuda else ring * row
            self._blurred = wp.empty(images.shape, dtype=wp.float32, device=self._device)
            self._rows = wp.empty(room, dtype=wp.float32, device=self._device)
        source, blurred, rows = images.flatten(), self._blurred.flatten(), self._rows
        if self._device.is_cuda:
            for shape, a, b in (((count * height, width, channels), source, rows),
                                ((count, height, row), rows, blurred)):  # fmt: skip
                wp.launch(
                    kernels.each_sample, shape, [self._weights, a, *shape[1:]], [b], device=self._device
                )  # fmt: skip
        else:
            inputs = [self._weights, source, height, width, channels]
            wp.launch(kernels.blur_rows, (count, height), inputs, [rows, blurred], device=self._device)
        return self._blurred
