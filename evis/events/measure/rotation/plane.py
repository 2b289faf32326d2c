"""Describes the plane of a rotation as the image shows it: a circle about the pivot is an ellipse when the plane is
tilted.

Far from the camera (weak perspective) image and plane are related by a linear map about the pivot. Up to the scale and
a turn within the plane, which say nothing of the speed, it is a stretch along one direction of the image: the
exponential of a symmetric matrix without trace, [[a, b], [b, -a]]. So areas are kept, and (0, 0) is a plane seen from
the front.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FRONT = (0.0, 0.0)


@dataclass(frozen=True)
class Plane:
    """Describes the plane of a rotation. pivot: float [2, px]; stretch: (a, b), the logarithm of the map from the image
    to the plane.
    """

    pivot: np.ndarray
    stretch: tuple[float, float] = FRONT

    @property
    def tilt_rad(self) -> float:
        """Returns the angle between the plane and the image plane: its cosine is the ratio of the ellipse's axes."""
        return float(np.arccos(np.exp(-2 * np.hypot(*self.stretch))))

    def from_image(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the coordinates in the plane from the pivot [n, px] of places in the image [n, px]."""
        return self._map(x - self.pivot[0], y - self.pivot[1], 1.0)

    def to_image(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reverses `from_image`."""
        x, y = self._map(u, v, -1.0)
        return x + self.pivot[0], y + self.pivot[1]

    def _map(self, dx: np.ndarray, dy: np.ndarray, sign: float) -> tuple[np.ndarray, np.ndarray]:
        a, b = self.stretch
        size = float(np.hypot(a, b))
        if size < 1e-9:
            return dx, dy
        even, odd = np.cosh(size), sign * np.sinh(size) / size
        return (even + odd * a) * dx + odd * b * dy, odd * b * dx + (even - odd * a) * dy
