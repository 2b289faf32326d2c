"""Computes shading normals of a mesh that has none of its own."""

from __future__ import annotations

import numpy as np

from evis.geometry.triangles import area_vectors

PAIRS = 4_000_000
"""Pairs of faces that are compared at a time, which bounds the memory."""


def crease_normals(vertices: np.ndarray, faces: np.ndarray, crease: float) -> np.ndarray:
    """Computes a unit normal per corner, float32 [F, 3, 3].

    The mean of the normals, weighted by area, of the faces that meet at the corner's position within `crease` [rad] of
    the corner's own face. So edges sharper than `crease` stay sharp. A face without area has normal 0.
    """
    points = np.asarray(vertices, np.float64)
    # Vertices at the same place count as one: files repeat them where texture coordinates differ.
    _, place = np.unique(points, axis=0, return_inverse=True)
    corner_place = place.reshape(-1)[faces].reshape(-1)
    area = area_vectors(points[faces])
    length = np.linalg.norm(area, axis=-1, keepdims=True)
    unit = np.divide(area, length, out=np.zeros_like(area), where=length > 0)
    order = np.argsort(corner_place, kind="stable")
    sorted_place = corner_place[order]
    start = np.flatnonzero(np.r_[True, np.diff(sorted_place) > 0])
    size = np.diff(np.r_[start, len(order)])
    result = np.zeros((len(faces) * 3, 3))
    cosine = np.cos(crease) - 1e-9
    # Corners around places with the same number of faces are one rectangular batch.
    for n in np.unique(size):
        corners = order[start[size == n][:, None] + np.arange(n)]
        owner = corners // 3
        if n * n > PAIRS:
            for place_corners, faces_there in zip(corners, owner):
                result[place_corners] = _crowded(unit[faces_there], area[faces_there], cosine)
            continue
        for part in np.array_split(np.arange(len(owner)), max(1, len(owner) * n * n // PAIRS)):
            u, weighted = unit[owner[part]], area[owner[part]]
            near = np.einsum("kix,kjx->kij", u, u) >= cosine
            result[corners[part]] = np.einsum("kij,kjx->kix", near, weighted)
    norm = np.linalg.norm(result, axis=-1, keepdims=True)
    flat = np.repeat(unit, 3, axis=0)
    return np.where(norm > 1e-300, result / np.maximum(norm, 1e-300), flat).reshape(-1, 3, 3).astype(np.float32)


def _crowded(unit: np.ndarray, area: np.ndarray, cosine: float) -> np.ndarray:
    """Sums [N, 3] of a place where very many faces meet, as in the middle of a fan, a part of them at a time."""
    # Faces in one plane count as one. Those without area, as in a collapsed part of a mesh, add nothing.
    kinds, kind = np.unique(unit, axis=0, return_inverse=True)
    weight = np.zeros_like(kinds)
    np.add.at(weight, kind.reshape(-1), area)
    sums = np.zeros_like(kinds)
    for part in np.array_split(np.arange(len(kinds)), max(1, len(kinds) ** 2 // PAIRS)):
        near = kinds[part] @ kinds.T >= cosine
        sums[part] = near.astype(np.float64) @ weight
    result: np.ndarray = sums[kind.reshape(-1)]
    return result
