"""Replaces a shape by a mesh of the user's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from evis.geometry.triangles import area_vectors
from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.mesh.files import Part, load_parts
from evis.scene.model import Mesh

LARGEST = 256 << 20
"""Largest file of a mesh [bytes]."""


def read_mesh(path: Path, textures: bool = True) -> list[Part]:
    """Reads the parts of a mesh, in the file's own units. Raises SceneError that names it."""
    size = path.stat().st_size
    if size > LARGEST:
        raise SceneError(f"{path.name} has {size >> 20} MiB; the most is {LARGEST >> 20} MiB, so simplify it")
    return load_parts(path, np.ones(3), textures=textures, folders=Folders(path.parent))


def fitted(parts: list[Part], shape: Mesh) -> list[Part]:
    """Moves and scales parts into the box of a shape: the same middle, and the longest side as long.

    What has no texture coordinates gets those of a projection along the axis that each triangle faces most, once over
    the longest side.
    """
    low, high = _bounds([part.points()[part.mesh.faces.reshape(-1)] for part in parts])
    into_low, into_high = _bounds([shape.vertices[shape.faces.reshape(-1)].astype(np.float64)])
    scale = float((into_high - into_low).max() / (high - low).max())
    shift = 0.5 * (into_low + into_high) - 0.5 * scale * (low + high)
    found = []
    for part in parts:
        mesh, points = part.mesh, part.points()
        vertices = (points * scale + shift).astype(np.float32)
        uv = _projected(points[mesh.faces], low, float((high - low).max())) if mesh.uv is None else mesh.uv
        found.append(replace(part, mesh=replace(mesh, vertices=vertices, uv=uv), place=None))
    return found


def _bounds(used: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinates of points [N, 3], float64 [3] each."""
    return np.min([v.min(axis=0) for v in used], axis=0), np.max([v.max(axis=0) for v in used], axis=0)


def _projected(corners: np.ndarray, low: np.ndarray, longest: float) -> np.ndarray:
    normal = area_vectors(corners)
    axis = np.abs(normal).argmax(axis=-1)
    across = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    unit = (corners - low) / longest
    return np.take_along_axis(unit, across[:, None, :].repeat(3, axis=1), axis=-1).astype(np.float32)
