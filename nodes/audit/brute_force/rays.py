"""Makes a camera of chosen pixels alone: the rays of those pixels, and the steps to their neighbours', in a small
table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evis.scene.model import Camera
from nodes.renderer.raster.lens.cameras import finer, lens_of, make_view
from nodes.renderer.raster.lens.view_kernels import CameraView

CELL = 3
"""Rows and columns of the table for each ray: the ray in the middle, and what `ray_steps` takes differences of."""


class PixelRays:
    """Finds the rays of a camera's pixels, each as n x n samples, as the renderer's kernels have them."""

    def __init__(self, camera: Camera, samples: int) -> None:
        """samples: n, along each side of a pixel."""
        self.samples = samples
        self._fine = finer(camera, samples)
        self.view: CameraView = make_view(self._fine, 0, "cpu")
        """The whole camera's view, on the CPU."""
        self.lens = lens_of(camera) != "none"

    def compact(self, count: int, rows: int) -> Camera:
        """Gives a pinhole of the same name with room for the table of `count` pixels in each of `rows`."""
        width = CELL * count * self.samples**2
        return replace(self._fine, width=width, height=CELL * rows, distortion_model="plumb_bob", distortion=(0.0,) * 5)

    def table(self, pixels: np.ndarray) -> np.ndarray:
        """Gives rays float32 [3 R, 3 M n^2, 3] of pixels int64 [R, M, 2] (x, y).

        The ray of a sample is in the middle of its 3 x 3 cells. Beside it and below stand twice its steps to the next
        column and row, opposite them zeros, for the kernels halve the differences.
        """
        n = self.samples
        offset = np.arange(n)
        x = (n * pixels[..., 0, None, None] + offset[None, :]).repeat(n, -2).reshape(len(pixels), -1)
        y = (n * pixels[..., 1, None, None] + offset[:, None]).repeat(n, -1).reshape(len(pixels), -1)
        table = np.zeros((len(pixels), CELL, x.shape[1], CELL, 3), np.float32)
        ray, across, down = self._rays(x, y)
        table[:, 1, :, 1] = ray
        table[:, 1, :, 2], table[:, 2, :, 1] = 2 * across, 2 * down
        return table.reshape(CELL * len(pixels), -1, 3)

    def cells(self, count: int, rows: int) -> np.ndarray:
        """Gives where the rays are: indices int64 [R, M, n^2] into the table of R rows of M pixels."""
        m = count * self.samples**2
        row, ray = np.arange(rows)[:, None], np.arange(m)[None]
        return ((CELL * row + 1) * CELL * m + CELL * ray + 1).reshape(rows, count, -1)

    def _rays(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rays [..., 3] and their steps to the next column and row, as `pixel_ray` and `ray_steps` have them."""
        view = self.view
        if not self.lens:
            one = np.ones(x.shape, np.float32)
            ray = np.stack([view.columns.numpy()[x], view.rows.numpy()[y], one], -1)
            across, down = np.zeros_like(ray), np.zeros_like(ray)
            across[..., 0] = np.float32(1) / np.float32(view.fx)
            down[..., 1] = np.float32(1) / np.float32(view.fy)
            return ray, across, down
        rays = view.rays.numpy()
        left, right = np.maximum(x - 1, 0), np.minimum(x + 1, view.width - 1)
        above, below = np.maximum(y - 1, 0), np.minimum(y + 1, view.height - 1)
        apart = np.maximum(right - left, 1).astype(np.float32)[..., None]
        across = (rays[y, right] - rays[y, left]) / apart
        return (
            rays[y, x],
            across,
            (rays[below, x] - rays[above, x]) / np.maximum(below - above, 1)[..., None].astype(np.float32),
        )
