"""Computes areas and normals of triangles, of their corners [n, 3, 3] (triangle, corner, axis)."""

from __future__ import annotations

import numpy as np


def area_vectors(corners: np.ndarray) -> np.ndarray:
    """Computes vectors [n, 3] along the triangles' normals, each twice as long as its triangle is large."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def areas(corners: np.ndarray) -> np.ndarray:
    """Computes the areas of triangles, [n] m^2."""
    return np.asarray(np.linalg.norm(area_vectors(corners), axis=-1) / 2)
