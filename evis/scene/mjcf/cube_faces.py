"""Cuts triangles that a cube texture lies on where it goes from one face of the cube to the next.

A texture that is looked up by direction is not one affine map over a large triangle: it bends at the cube's edges, and
within a face as the direction's largest coordinate changes.
"""

from __future__ import annotations

import numpy as np

from evis.scene.model import Mesh

_PLANES = np.array([(1, -1, 0), (1, 1, 0), (1, 0, -1), (1, 0, 1), (0, 1, -1), (0, 1, 1)], np.float64)
"""Normals of the planes between faces of the cube."""
_WIDE = 0.15
"""Angle [rad] across a triangle up to which it is left whole: parts of a texel, or too small to be seen."""
_ERROR = 0.03
"""Of the texture in the middle of an edge, in half-sizes of a face."""
_MOST_CUTS = 12
"""Halvings of a triangle; those that go by the cube's middle have no end."""


def cube_face(directions: np.ndarray) -> np.ndarray:
    """Returns which face of the cube directions [n, 3] meet, 0 to 5: +x, -x, +y, -y, +z, -z."""
    axis = np.argmax(np.abs(directions), axis=-1)
    return 2 * axis + (np.take_along_axis(directions, axis[:, None], axis=-1)[:, 0] < 0)


def divide(mesh: Mesh, directions: np.ndarray) -> np.ndarray:
    """Divides the wide triangles of a mesh so that each lies within one face of the cube, and returns the directions of
    all corners [F', 3, 3]. directions: of its corners, float64 [F, 3, 3], affine over each triangle.
    """
    unit = directions / np.maximum(np.linalg.norm(directions, axis=-1, keepdims=True), 1e-300)
    wide = (np.einsum("fkx,fkx->fk", unit, np.roll(unit, -1, axis=1)) < np.cos(_WIDE)).any(axis=-1)
    if not wide.any():
        return directions
    chosen = np.flatnonzero(wide)
    owners, shares = [], []  # of each piece: the triangle, and its corners as shares of the triangle's [3, 3]
    for number in chosen:
        for piece in _pieces(directions[number]):
            owners.append(number)
            shares.append(piece)
    owner, share = _halved(np.array(owners), np.array(shares), directions)
    if len(owner) == len(chosen):
        return directions
    keep = ~wide
    first = len(mesh.vertices)
    added = share @ mesh.vertices[mesh.faces[owner]].astype(np.float64)
    mesh.vertices = np.concatenate([mesh.vertices, added.reshape(-1, 3).astype(np.float32)])
    numbers = first + np.arange(3 * len(owner), dtype=np.int32).reshape(-1, 3)
    if mesh.normals is not None:
        normals = share @ mesh.normals[owner].astype(np.float64)
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
        mesh.normals = np.concatenate([mesh.normals[keep], normals.astype(np.float32)])
    mesh.faces = np.concatenate([mesh.faces[keep], numbers])
    return np.concatenate([directions[keep], share @ directions[owner]])


def _pieces(corners: np.ndarray) -> list[np.ndarray]:
    """Triangles, as shares of the corners [3, 3], of a triangle that is cut by all planes between faces."""
    polygons = [np.eye(3)]
    tolerance = 1e-6 * np.abs(corners).max()  # as exact as vertices are
    for plane in _PLANES:
        cut = []
        for polygon in polygons:
            side = polygon @ corners @ plane
            side[np.abs(side) < tolerance] = 0.0
            if side.min() >= 0 or side.max() <= 0 or _within_one_face(polygon @ corners, tolerance):
                cut.append(polygon)
            else:
                cut += [_half(polygon, side), _half(polygon, -side)]
        polygons = cut
    return [polygon[[0, k, k + 1]] for polygon in polygons for k in range(1, len(polygon) - 1)]


def _within_one_face(corners: np.ndarray, tolerance: float) -> bool:
    """Whether a coordinate of one sign is the largest of all corners."""
    least = np.abs(corners).max(axis=-1) - tolerance
    return bool(((corners >= least[:, None]).all(axis=0) | (corners <= -least[:, None]).all(axis=0)).any())


def _half(polygon: np.ndarray, side: np.ndarray) -> np.ndarray:
    """The part of a convex polygon where `side`, of its corners, is not below 0."""
    found = []
    for k in range(len(polygon)):
        a, b = polygon[k - 1], polygon[k]
        if side[k - 1] * side[k] < 0:
            found.append(a + (b - a) * (side[k - 1] / (side[k - 1] - side[k])))
        if side[k] >= 0:
            found.append(b)
    return np.array(found)


def _halved(owner: np.ndarray, share: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pieces halved across the edge along which the texture bends most, as long as it does so much."""
    for _ in range(_MOST_CUTS):
        corners = share @ directions[owner]
        axis = cube_face(corners.mean(axis=1)) // 2
        major = np.abs(np.take_along_axis(corners, axis[:, None, None], axis=-1)[..., 0])
        places = corners / np.maximum(major, 1e-12)[..., None]
        middles = (corners + np.roll(corners, -1, axis=1)) / np.maximum(major + np.roll(major, -1, axis=1), 1e-12)[
            ..., None
        ]
        error = np.abs(middles - 0.5 * (places + np.roll(places, -1, axis=1))).max(axis=-1)
        bent = error.max(axis=-1) > _ERROR
        if not bent.any():
            break
        piece, at = share[bent], np.arange(int(bent.sum()))
        first = error[bent].argmax(axis=-1)
        second, third = (first + 1) % 3, (first + 2) % 3
        middle = 0.5 * (piece[at, first] + piece[at, second])
        one = np.stack((piece[at, first], middle, piece[at, third]), axis=1)
        other = np.stack((middle, piece[at, second], piece[at, third]), axis=1)
        owner = np.concatenate([owner[~bent], owner[bent], owner[bent]])
        share = np.concatenate([share[~bent], one, other])
    return owner, share
