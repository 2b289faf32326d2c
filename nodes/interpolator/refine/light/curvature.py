"""Computes how strongly round shapes are curved, by the normals that they are shaded with."""

from __future__ import annotations

import numpy as np

from evis.geometry.triangles import areas
from nodes.renderer.geometry.triangles import Geometry

SHARE = 0.25
"""Part of a mesh's surface that is curved at least as much as the mesh counts for: rounded edges of a box are less."""


def curvature_of(geometry: Geometry, instance: int) -> tuple[float, float]:
    """Computes the greater and the lesser principal curvature of an instance's mesh [1/m]: what a quarter of its
    surface has at least, and the median of that quarter; 0, 0 where less is curved.

    How the normal changes over each triangle is solved for its two edges (the shape operator: Rusinkiewicz, Estimating
    Curvatures and Their Derivatives on Triangle Meshes, 2004).
    """
    own = slice(int(geometry.first[instance]), int(geometry.first[instance + 1]))
    corners = geometry.vertices[geometry.triangles[own]].astype(np.float64)
    area = areas(corners)
    if geometry.smooth is None or not area.sum() > 0:
        return 0.0, 0.0
    greater, lesser = _principal(corners, geometry.normals[own], geometry.smooth.reshape(-1, 3, 3)[own])
    order = np.argsort(-greater)
    so_far = np.cumsum(area[order])
    last = int(np.searchsorted(so_far, SHARE * so_far[-1]))
    most = order[: last + 1]
    of_those = most[np.argsort(lesser[most])]
    middle = np.searchsorted(np.cumsum(area[of_those]), so_far[last] / 2)
    return float(greater[order[last]]), float(lesser[of_those[middle]])


def _principal(corners: np.ndarray, plane: np.ndarray, shaded: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes both principal curvatures of triangles [n, 3, 3] with normals plane [n, 3] and shaded [n, 3, 3], float64
    [n], the greater first, without signs; 0 of what is shaded flat, or has no area."""
    edges = corners[:, 1:] - corners[:, :1]
    length = np.linalg.norm(edges[:, 0], axis=-1, keepdims=True)
    along = np.divide(edges[:, 0], length, out=np.zeros_like(edges[:, 0]), where=length > 0)
    basis = np.stack([along, np.cross(plane, along)], axis=-1)
    normals = shaded.astype(np.float64)
    # A normal of 0 stands for the plane's.
    normals = np.where((normals == 0).all(axis=-1, keepdims=True), plane[:, None], normals)
    ways, turns = edges @ basis, (normals[:, 1:] - normals[:, :1]) @ basis
    whole = np.abs(np.linalg.det(ways)) > 1e-12 * length[:, 0] ** 2
    operator = np.zeros((len(corners), 2, 2))
    operator[whole] = np.linalg.solve(ways[whole], turns[whole])
    values = np.sort(np.abs(np.linalg.eigvalsh((operator + operator.swapaxes(1, 2)) / 2)), axis=-1)
    return values[:, 1], values[:, 0]
