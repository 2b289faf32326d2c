"""Finds the instances whose triangles are the sides of a box: shadow rays are tried against that, and not the mesh."""

from __future__ import annotations

import numpy as np

from evis.scene.model import Mesh
from nodes.renderer.raster.visibility import Visibility

ROUNDING = 2.5e-7
"""Of a mesh's largest coordinate, within which places are one: as good as float32 tells."""


def box_halves(visibility: Visibility) -> np.ndarray:
    """Gives half the sides [m] of instances that are boxes in their own frames, or rectangles, whose third side is 0;
    float64 [I, 3], 0 for all others."""
    geometry = visibility.geometry

    def found() -> np.ndarray:
        known: dict[int, np.ndarray] = {}
        for mesh in geometry.meshes:
            if id(mesh) not in known:
                known[id(mesh)] = half_of(mesh)
        return np.array([known[id(mesh)] for mesh in geometry.meshes]).reshape(-1, 3)

    return geometry.once("boxes", found)


def half_of(mesh: Mesh) -> np.ndarray:
    """Gives half the sides [m] of a mesh that is the surface of an upright box or rectangle, in however many triangles;
    float64 [3], 0 for any other."""
    none = np.zeros(3)
    if not len(mesh.faces):
        return none
    points = np.asarray(mesh.vertices, np.float64)
    near = ROUNDING * np.abs(points).max()
    points = (points - (points.min(0) + points.max(0)) / 2)[np.asarray(mesh.faces)]
    half = np.abs(points).max((0, 1))
    flat = half <= near
    if flat.sum() > 1:
        return none
    points = points[np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1) > 0]
    sides = [(k, sign) for k in range(3) for sign in (-1, 1) if flat[k] or not flat.any()]
    left = np.ones(len(points), bool)
    for k, sign in sides[: 1 if flat.any() else 6]:
        on = (sign * points[:, :, k] >= half[k] - near).all(1)
        across = [axis for axis in range(3) if axis != k]
        if not tiles(points[on][:, :, across], half[across], near):
            return none
        left &= ~on
    return none if left.any() else np.where(flat, 0.0, half)


def tiles(triangles: np.ndarray, half: np.ndarray, near: float) -> bool:
    """Tells whether triangles [n, 3, 2] cover a rectangle about the origin, each part of it once.

    So they do if all are turned the same way, have its area together, and are beside another one at every edge that is
    not the rectangle's own. half [2]: of its sides; near: difference up to which places are one.
    """
    edges = triangles - triangles[:, :1]
    area = 0.5 * (edges[:, 1, 0] * edges[:, 2, 1] - edges[:, 1, 1] * edges[:, 2, 0])
    if (area > 0).any() and (area < 0).any():
        return False
    whole = 4.0 * half[0] * half[1]
    if abs(abs(area.sum()) - whole) > 1e-6 * whole:
        return False
    _, number = np.unique(np.rint(triangles.reshape(-1, 2) / near).astype(np.int64), axis=0, return_inverse=True)
    corner = number.reshape(-1, 3)
    start, end = corner.reshape(-1), np.roll(corner, -1, axis=1).reshape(-1)
    count = corner.max() + 1
    forth, back = start * count + end, end * count + start
    if len(np.unique(forth)) < len(forth):
        return False
    a, b = triangles.reshape(-1, 2), np.roll(triangles, -1, axis=1).reshape(-1, 2)
    border = ((np.abs(a - np.sign(a) * half) <= near) & (np.abs(b - np.sign(a) * half) <= near)).any(1)
    return bool((np.isin(forth, back) | border).all())
