"""Tells what is inside of closed meshes, and those whose faces are turned inwards."""

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


def surrounds(mesh: Mesh, point: np.ndarray) -> bool:
    """Tells whether a point float64 [3] of a mesh's frame is inside of it: closed, with faces that look outwards.

    By its winding number, the sum of the solid angles of the triangles (A. van Oosterom, J. Strackee, The Solid Angle
    of a Plane Triangle, 1983).
    """
    corners = mesh.vertices.astype(np.float64)[mesh.faces] - point
    a, b, c = corners.transpose(1, 0, 2)
    la, lb, lc = np.linalg.norm(corners, axis=-1).T
    triple = np.einsum("fx,fx->f", a, np.cross(b, c))
    below = la * lb * lc + lc * (a * b).sum(-1) + lb * (a * c).sum(-1) + la * (b * c).sum(-1)
    return bool(np.arctan2(triple, below).sum() / (2 * np.pi) > 0.5) and _is_closed(mesh)


def _is_closed(mesh: Mesh) -> bool:
    """Whether every edge is passed as often in one direction as in the other."""
    # Vertices at the same place count as one: STL has three for each triangle.
    _, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[mesh.faces].astype(np.int64)
    start, end = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    edges = np.minimum(start, end) * len(mesh.vertices) + np.maximum(start, end)
    _, number = np.unique(edges, return_inverse=True)
    return not np.bincount(number.reshape(-1), weights=np.sign(end - start)).any()
