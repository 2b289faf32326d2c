"""Relates the places in a camera's image to directions and points in its frame, in float64, with or without a lens's
distortion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evis.geometry import distortion, pinhole
from evis.geometry.distortion import Lens


@dataclass(frozen=True)
class Projection:
    """Holds the intrinsics k of a camera, float64 [3, 3] px, and its lens, None for a pinhole."""

    k: np.ndarray
    lens: Lens | None = None

    @classmethod
    def of(cls, k: np.ndarray, model: str, coefficients: Sequence[float] | np.ndarray) -> Projection:
        """Makes the projection that a scene's camera or CameraInfo describes. Raises ValueError for an unknown
        model."""
        straight = model == "none" or (model == "plumb_bob" and not np.any(coefficients))
        lens = None if straight else Lens.of(model, np.asarray(coefficients, np.float64).tolist())
        return cls(np.asarray(k, np.float64), lens)

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Gives the unit directions [..., 3] of places [..., 2] px; NaN where a lens sees nothing."""
        if self.lens is not None:
            return distortion.unproject(self.k, self.lens, pixels)
        rays = pinhole.unproject(self.k, pixels, np.ones(pixels.shape[:-1]))
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def places(self, points: np.ndarray) -> np.ndarray:
        """Gives the places [..., 2] px of points [..., 3]; NaN for those that no pixel could see."""
        if self.lens is not None:
            return distortion.project(self.k, self.lens, points)
        with np.errstate(divide="ignore", invalid="ignore"):
            places = pinhole.project(self.k, points)
        return np.where(points[..., 2:] > 0, places, np.nan)

    def derivative(self, directions: np.ndarray) -> np.ndarray:
        """Gives d(pixel) / d(X, Y, Z) [..., 2, 3] px/m at a distance of 1 m in unit directions [..., 3]."""
        if self.lens is not None:
            return np.diag(np.diag(self.k)[:2]) @ self.lens.derivative(directions)
        return self._pinhole_derivative(directions)

    def at_unit_depth(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gives the points [..., 3] with z = 1 m that places [..., 2] px show, and d(pixel) / d(X, Y, Z) there
        [..., 2, 3] px/m."""
        if self.lens is None:
            points = pinhole.unproject(self.k, pixels, np.ones(pixels.shape[:-1]))
            return points, self._pinhole_derivative(points)
        unit = self.directions(pixels)
        with np.errstate(divide="ignore", invalid="ignore"):
            return unit / unit[..., 2:], self.derivative(unit) * unit[..., 2, None, None]

    def _pinhole_derivative(self, points: np.ndarray) -> np.ndarray:
        """Gives d(pixel) / d(X, Y, Z) of a pinhole [..., 2, 3] px/m at points [..., 3]."""
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        zero = np.zeros_like(x)
        u, v = np.stack((1 / z, zero, -x / z**2), -1), np.stack((zero, 1 / z, -y / z**2), -1)
        return np.asarray(self.k[:2, :2] @ np.stack((u, v), -2))
