"""Finds boxes that tell of a shadow ray what triangles would: what instances are, and what is within convex ones."""

from __future__ import annotations

import numpy as np

from evis.geometry.triangles import area_vectors
from evis.scene.model import Mesh
from nodes.renderer.geometry.triangles import SHELL_CONVEX
from nodes.renderer.raster.visibility import Visibility

ROUNDING = 2.5e-7
"""Of a mesh's largest coordinate, within which places are one: as good as float32 tells."""
SHRUNK = 1e-5
"""How much smaller a box within a mesh is than it could be, as a part: more than float32 rounds its triangles by."""


def half_extents(visibility: Visibility) -> np.ndarray:
    """Gives half the sides of every instance's box in its own frame, float64 [I, 3] m."""
    geometry = visibility.geometry

    def largest() -> np.ndarray:
        half = np.zeros((len(geometry.body), 3))
        # Vertices lie in the order of their instances.
        there, first = np.unique(geometry.vertex_instance, return_index=True)
        if len(there):
            half[there] = np.maximum.reduceat(np.abs(geometry.vertices), first)
        return half * (1 + 1e-6)

    return geometry.once("half extents", largest)


def core_halves(visibility: Visibility) -> np.ndarray:
    """Gives half the sides [m] of a box about the origin of each instance's frame that is within its triangles, where
    these are convex and seen from outside; float64 [I, 3], 0 for all others."""
    geometry, outer = visibility.geometry, half_extents(visibility)

    def found() -> np.ndarray:
        known: dict[int, np.ndarray] = {}
        cores = np.zeros((len(geometry.body), 3))
        for instance in np.flatnonzero(geometry.shell == SHELL_CONVEX):
            mesh = id(geometry.meshes[instance])
            if mesh not in known:
                own = slice(geometry.first[instance], geometry.first[instance + 1])
                corners = geometry.vertices[geometry.triangles[own]].astype(np.float64)
                known[mesh] = core_of(outer[instance], corners, geometry.normals[own].astype(np.float64))
            cores[instance] = known[mesh]
        return cores

    return geometry.once("cores", found)


def core_of(outer: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Finds a large box about the origin within a convex surface: half its sides, float64 [3], 0 where the surface has
    holes, or the origin is not within it.

    outer [3]: half the sides of a box around all. corners [F, 3, 3] m, normals [F, 3]: of its triangles, the latter 0
    where these have no area.
    """
    there = (normals != 0).any(axis=1)
    # How far from the origin the planes are.
    far = np.einsum("nk,nck->nc", normals, corners).min(axis=1)[there]
    if not len(far) or far.min() <= 0 or not closed(corners):
        return np.zeros(3)
    slopes = np.abs(normals[there])
    half = outer * (far / (slopes @ outer)).min()
    # In turn each side grows until a plane stops it.
    for axis in range(3):
        stops = slopes[:, axis] > 0
        others = slopes[stops] @ half - slopes[stops, axis] * half[axis]
        half[axis] = ((far[stops] - others) / slopes[stops, axis]).min()
    return half * (1 - SHRUNK)


def closed(corners: np.ndarray) -> bool:
    """Tells whether triangles [F, 3, 3] have another one at every edge, turned the same way."""
    number, count = _numbered(corners, ROUNDING * np.abs(corners).max())
    number = number[(number != np.roll(number, 1, axis=1)).all(axis=1)]
    start, end = number.reshape(-1), np.roll(number, -1, axis=1).reshape(-1)
    forth, back = np.sort(start * count + end), np.sort(end * count + start)
    return bool(np.array_equal(forth, back) and (np.diff(forth) > 0).all())


def _numbered(points: np.ndarray, near: float) -> tuple[np.ndarray, int]:
    """Gives each place [F, 3, D] a number [F, 3], the same where they are `near`, and how many there may be."""
    flat = np.rint(points.reshape(-1, points.shape[-1]) / near).astype(np.int64)
    _, number = np.unique(flat, axis=0, return_inverse=True)
    return number.reshape(points.shape[:2]), int(number.max()) + 1


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
    points = points[np.linalg.norm(area_vectors(points), axis=1) > 0]
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
    corner, count = _numbered(triangles, near)
    start, end = corner.reshape(-1), np.roll(corner, -1, axis=1).reshape(-1)
    forth, back = start * count + end, end * count + start
    if len(np.unique(forth)) < len(forth):
        return False
    a, b = triangles.reshape(-1, 2), np.roll(triangles, -1, axis=1).reshape(-1, 2)
    border = ((np.abs(a - np.sign(a) * half) <= near) & (np.abs(b - np.sign(a) * half) <= near)).any(1)
    return bool((np.isin(forth, back) | border).all())
