"""Computes how far off its optical axis a camera sees, and things are."""

from __future__ import annotations

import numpy as np

from evis.geometry import pinhole
from evis.geometry.distortion import Lens, unproject
from evis.scene.model import Camera


def widest_angle(camera: Camera) -> float:
    """Computes the angle [rad] about the optical axis within which the whole picture is; pi where a lens hides it."""
    x, y = np.arange(-0.5, camera.width), np.arange(-0.5, camera.height)
    sides = [np.stack(np.broadcast_arrays(x, v), axis=-1) for v in (y[0], y[-1])]
    sides += [np.stack(np.broadcast_arrays(u, y), axis=-1) for u in (x[0], x[-1])]
    border = np.concatenate(sides)
    if camera.distortion_model == "none":
        rays = pinhole.unproject(camera.k, border, np.ones(len(border)))
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    else:
        rays = unproject(camera.k, Lens.of(camera.distortion_model, camera.distortion), border)
    # Where a lens sees nothing there is no ray: what it sees then is not known here.
    least = rays[:, 2].min()
    return float(np.arccos(np.clip(least, -1.0, 1.0))) if np.isfinite(least) else np.pi


def least_angle(middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Computes the least angles [rad] between the optical axis and a point of balls, [n]; 0 for a camera in one.

    middle: float64 [n, 3] in the camera's frame [m]. radius: [n] m.
    """
    distance = np.maximum(np.linalg.norm(middle, axis=-1), np.finfo(np.float64).tiny)
    angle = np.arccos(np.clip(middle[:, 2] / distance, -1.0, 1.0)) - np.arcsin(np.minimum(radius / distance, 1.0))
    return np.where(distance <= radius, 0.0, angle)
