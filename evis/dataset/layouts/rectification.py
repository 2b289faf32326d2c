"""Maps a camera's own pixels to those of a pinhole with its intrinsics, and back; DSEC's calibration."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.geometry.distortion import Lens, project, unproject
from evis.geometry.pinhole import pixel_grid
from msgs.camera import CameraInfo


class Rectification:
    """Takes the distortion out of positions and images of one camera; without any, nothing is moved.

    The cameras of a stereo pair are parallel, so the rectified ones have the intrinsics of the camera itself.
    """

    def __init__(self, info: CameraInfo) -> None:
        self.info = info
        plain = info.distortion_model == "plumb_bob" and not np.any(info.distortion)  # a fisheye bends without any too
        self.straight = plain or info.distortion_model == "none"

    @cached_property
    def map(self) -> np.ndarray:
        """Returns the rectified position of every pixel, float32 [H, W, 2] (x, y) px; NaN where there is none."""
        grid = pixel_grid(self.info.width, self.info.height)
        return (grid if self.straight else self.rectified(grid)).astype(np.float32)

    @cached_property
    def _source(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The own pixel (y, x) that is nearest to each rectified one, and whether there is one."""
        k, size = self.info.k, (self.info.width, self.info.height)
        grid = pixel_grid(*size)
        rays = np.stack(
            ((grid[..., 0] - k[0, 2]) / k[0, 0], (grid[..., 1] - k[1, 2]) / k[1, 1], grid[..., 0] * 0 + 1), -1
        )
        own = np.rint(project(k, self._lens, rays))
        with np.errstate(invalid="ignore"):
            there = ((own >= 0) & (own < size)).all(-1)
        x, y = np.where(there[..., None], own, 0).astype(np.intp).transpose(2, 0, 1)
        return y, x, there

    @cached_property
    def _lens(self) -> Lens:
        try:
            return Lens.of(self.info.distortion_model, np.asarray(self.info.distortion).tolist())
        except ValueError as error:
            raise LayoutError(
                f"{self.info.name}, as its info has it, cannot be rectified: {error}; the layouts npz, zarr, "
                "webdataset, coco and mcap need no rectification"
            ) from None

    def rectified(self, pixels: np.ndarray) -> np.ndarray:
        """Computes the rectified positions float64 [..., 2] of own ones; NaN where there is none."""
        if self.straight:
            return np.asarray(pixels, np.float64)
        k, rays = self.info.k, unproject(self.info.k, self._lens, pixels)
        with np.errstate(invalid="ignore", divide="ignore"):
            xy = np.where(rays[..., 2:] > 0, rays[..., :2] / rays[..., 2:], np.nan)
        return np.stack((k[0, 0] * xy[..., 0] + k[0, 2], k[1, 1] * xy[..., 1] + k[1, 2]), -1)

    def image(self, own: np.ndarray, fill: Any) -> np.ndarray:
        """Returns the rectified image [H, W, ...] of an own one, each pixel the nearest; `fill` where there is none."""
        if self.straight:
            return own
        y, x, there = self._source
        return np.where(there.reshape(*there.shape, *[1] * (own.ndim - 2)), own[y, x], np.asarray(fill, own.dtype))

    def flow(self, own: np.ndarray) -> np.ndarray:
        """Returns displacements [H, W, 2] px between rectified positions, at rectified pixels; NaN where unknown."""
        if self.straight:
            return own
        grid = pixel_grid(self.info.width, self.info.height)
        moved = self.rectified(grid + own) - self.rectified(grid)
        return self.image(moved, np.nan)
