"""Tells meshes whose faces are turned inwards."""

from __future__ import annotations

import numpy as np

from evis.geometry.triangles import area_vectors
from evis.scene.model import Mesh


def is_inside_out(mesh: Mesh) -> bool:
    """Tells whether a mesh is closed and its faces, all in all, look inwards: its volume is negative.

    By the divergence theorem, of which every edge has to be passed as often in one direction as in the other. A solid
    with a hollow in it is right, for the volume inside of its outer faces is the larger one.
    """
    points = mesh.vertices.astype(np.float64)[mesh.faces]
    points -= points.reshape(-1, 3).mean(axis=0)
    volume = np.einsum("fx,fx->", points[:, 0], area_vectors(points)) / 6
    # Rounding, of meshes that are flat.
    if volume >= -1e-9 * float(np.ptp(points.reshape(-1, 3), axis=0).max()) ** 3:
        return False
    return _is_closed(mesh)


def _is_closed(mesh: Mesh) -> bool:
    """Whether every edge is passed as often in one direction as in the other."""
    # Vertices at the same place count as one: STL has three for each triangle.
    _, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[mesh.faces].astype(np.int64)
    start, end = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    edges = np.minimum(start, end) * len(mesh.vertices) + np.maximum(start, end)
    _, number = np.unique(edges, return_inverse=True)
    return not np.bincount(number.reshape(-1), weights=np.sign(end - start)).any()
