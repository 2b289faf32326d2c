"""Finds the four sides of the pyramid that a camera sees."""

from __future__ import annotations

from typing import Any

LEAST_Z = 0.05
"""z of a ray of length 1 below which the image is too wide to have four sides."""


def frustum_slopes(view: Any) -> tuple[float, float, float, float] | None:
    """Gives the least and greatest x / z, then y / z, of the rays of a CameraView; None where it looks too far
    sideways."""
    if view.distorted:
        rays = view.rays.numpy().reshape(-1, 3)
        if rays[:, 2].min() < LEAST_Z:
            return None
        across, down = (rays[:, axis] / rays[:, 2] for axis in (0, 1))
    else:
        across, down = view.columns.numpy(), view.rows.numpy()
    return float(across.min()), float(across.max()), float(down.min()), float(down.max())
