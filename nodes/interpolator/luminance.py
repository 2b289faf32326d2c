"""Computes the luminance of a keyframe, equation (3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator import image_kernels


def luminance_of(radiance: np.ndarray | wp.array, device: Any = "cpu") -> wp.array:
    """Gives float32 Rec. 709 luminance [E, H, W] of linear radiance [E, H, W, 3] in float32 or float16, on the device.

    That of float16 is as exact as float16. What is luminance [E, H, W] already is as it is, copied only where needed.
    """
    pixels = scalars(radiance, device)
    if pixels.ndim == 3:
        return _single(pixels)
    image = wp.empty(pixels.shape[:-1], dtype=wp.float32, device=device)
    wp.launch(image_kernels.luminance, image.size, [pixels.reshape((-1, 3))], [image.flatten()], device=device)
    return image


def rgb_of(radiance: np.ndarray | wp.array, device: Any = "cpu") -> wp.array:
    """Gives the wp.vec3 [...] linear RGB of radiance [..., 3] in float32 or float16, on the device; a copy only where
    needed."""
    pixels = _single(scalars(radiance, device))
    return pixels.view(wp.vec3).reshape(pixels.shape[:-1])


def as_frame(image: np.ndarray | wp.array, margin: int, colour: bool, device: Any) -> wp.array:
    """Gives keyframes [E, H, W(, 3)] as frames without their margin, luminance or vec3 [E, 1, h, w], on the device."""
    made = (rgb_of if colour else luminance_of)(image, device)
    inner = made[:, margin : made.shape[1] - margin, margin : made.shape[2] - margin].contiguous()
    return inner.reshape((inner.shape[0], 1, *inner.shape[1:]))


def _single(pixels: wp.array) -> wp.array:
    """Converts pixels to float32; copies only where they are not."""
    if pixels.dtype is wp.float32:
        return pixels
    single: wp.array = wp.empty(pixels.shape, dtype=wp.float32, device=pixels.device)
    wp.utils.array_cast(pixels.flatten(), single.flatten())
    return single


def scalars(image: np.ndarray | wp.array, device: Any) -> wp.array:
    """Gives an image on the device, without a copy where it is there, its vectors as one more axis."""
    if not isinstance(image, wp.array):
        return wp.array(image, device=device, copy=False)
    length = getattr(image.dtype, "_length_", 1)
    if length > 1:
        scalar: Any = getattr(image.dtype, "_wp_scalar_type_", None)
        image = image.view(scalar).reshape((*image.shape, length))
    there: Any = image
    return there.to(device)
