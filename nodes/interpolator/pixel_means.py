"""Averages the samples of supersampled pixels in frames, which keyframes hold apart as pixels of a larger image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from evis.scene.model import Camera
from nodes.interpolator import image_kernels

Allocate = Callable[[tuple[int, ...]], np.ndarray | wp.array]
"""Gives the memory for frames of a shape: numpy's, or on the device, [E, K, h, w] of float32 or, in colour, vec3."""


def new_frames(shape: tuple[int, ...]) -> np.ndarray:
    """Gives frames in memory of their own."""
    return np.empty(shape, np.float32)


def new_frames_on(device: wp.Device, shape: tuple[int, ...]) -> np.ndarray | wp.array:
    """Gives frames in memory of their own on a device, in colour of vec3 on a GPU; shape: as for `new_frames`."""
    if device.is_cpu:
        return new_frames(shape)
    pixel: Any = wp.vec3 if len(shape) == 5 else wp.float32
    return wp.empty(shape[:4], dtype=pixel, device=device)


class PixelMeans:
    """Tells how large the frames of keyframes are, holds them until their samples are averaged, and averages these.

    samples: n, of n x n samples per pixel, 1 for keyframes of single samples.
    """

    def __init__(self, camera: Camera | None, colour: bool, device: wp.Device) -> None:
        """Takes what frames are of. camera: by whose size n is known; without one it is 1. colour: of RGB, not
        luminance."""
        self._camera, self._device = camera, device
        self._channels = 3 if colour else 1
        self._size = 0, 0
        self._made: Any = None
        self.samples = 1

    def fit(self, height: int, width: int, margin: int) -> None:
        """Takes keyframes of a size from now on, margin included [px]. Raises ValueError where that is no multiple of
        the camera's."""
        camera, n = self._camera, 1
        inner = height - 2 * margin, width - 2 * margin
        if camera is not None:
            n = inner[0] // camera.height
            if inner != (n * camera.height, n * camera.width) or margin % max(n, 1):
                raise ValueError(
                    f"keyframes are {width}x{height} px with a margin of {margin} px, camera '{camera.name}' is "
                    f"{camera.width}x{camera.height} px; give renderer and interpolator the same scene and size"
                )
        self._size, self.samples = (inner[0], inner[1]), n

    def shape(self, envs: int, k: int) -> tuple[int, ...]:
        """Gives the shape of K frames of E environments: [E, K, h, w] or, in colour, [E, K, h, w, 3]."""
        return self._shape(envs, k, self.samples)

    def fine(self, envs: int, k: int, on_device: bool) -> Any:
        """Gives memory for K frames of samples, the same at every call for as many."""
        shape = self._shape(envs, k, 1)
        if self._made is None or tuple(self._made.shape[:4]) != shape[:4]:
            self._made = new_frames_on(self._device, shape) if on_device else new_frames(shape)
        return self._made

    def target(self, out: np.ndarray | wp.array) -> Any:
        """Gives where frames that are wanted in `out` are made: there, unless their samples are to be averaged."""
        return out if self.samples == 1 else self.fine(out.shape[0], out.shape[1], isinstance(out, wp.array))

    def average(self, made: Any, out: np.ndarray | wp.array) -> None:
        """Averages the samples of frames that were made in `target` into `out`, if there are several."""
        if self.samples == 1:
            return
        arrays: list[wp.array] = []
        for image in (made, out):
            shape = (image.shape[0] * image.shape[1], image.shape[2], image.shape[3] * self._channels)
            if isinstance(image, wp.array):
                arrays.append(image.flatten().view(wp.float32).reshape(shape))
            else:
                arrays.append(wp.array(image, dtype=wp.float32, shape=shape, copy=False, device="cpu"))
        dim, device = arrays[1].shape[:2], arrays[1].device
        wp.launch(image_kernels.mean, dim, [self.samples, self._channels, arrays[0]], [arrays[1]], device=device)

    def _shape(self, envs: int, k: int, samples: int) -> tuple[int, ...]:
        height, width = (length // samples for length in self._size)
        return (envs, k, height, width, *((3,) if self._channels == 3 else ()))
