"""Rings, rocks and leaves: closed, of the size that they are given, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from evis.scene.images import textures
from evis.scene.mesh import solids
from evis.scene.model import Mesh


def volume(mesh: Mesh) -> float:
    """By the divergence theorem; positive where faces look outwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(np.float64) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def edges_meet(mesh: Mesh) -> bool:
    """Whether each edge has a face on both sides, vertices at one place being one."""
    _, place = np.unique(mesh.vertices.round(6), axis=0, return_inverse=True)
    faces = place.reshape(-1)[mesh.faces]
    edges = [tuple(edge) for i in range(3) for edge in faces[:, [i, (i + 1) % 3]].tolist() if edge[0] != edge[1]]
    return sorted(edges) == sorted((b, a) for a, b in edges)


def test_torus_is_a_closed_ring() -> None:
    """Its volume is 2 pi^2 R r^2, less what chords of 48 and 12 sides cut off (0.3 % and 4.5 %)."""
    mesh = solids.torus(0.5, 0.1)
    assert edges_meet(mesh) and 0.93 < volume(mesh) / (2 * np.pi**2 * 0.5 * 0.1**2) < 1
    assert np.allclose(mesh.vertices.max(0), [0.6, 0.6, 0.1], atol=1e-6)
    middle = mesh.vertices[mesh.faces].mean(1)
    ring = np.c_[middle[:, :2] / np.linalg.norm(middle[:, :2], axis=1, keepdims=True) * 0.5, np.zeros(len(middle))]
    assert mesh.normals is not None and (np.einsum("ij,ij->i", mesh.normals.mean(1), middle - ring) > 0.09).all()
    with pytest.raises(ValueError, match="must be less than the ring's"):
        solids.torus(0.1, 0.2)


def test_rock_is_closed_and_within_its_radius() -> None:
    mesh = solids.rock(0.5, 0.6, 7)
    reach = np.linalg.norm(mesh.vertices, axis=1)
    assert edges_meet(mesh) and np.isclose(reach.max(), 0.5, atol=1e-6) and 0.19 < reach.min() < 0.3
    assert 0 < volume(mesh) < 4 / 3 * np.pi * 0.5**3
    assert np.array_equal(mesh.vertices, solids.rock(0.5, 0.6, 7).vertices)
    assert not np.allclose(mesh.vertices, solids.rock(0.5, 0.6, 8).vertices, atol=0.01)
    assert 0.97 < volume(solids.rock(0.5, 0.0, 7)) / (4 / 3 * np.pi * 0.5**3) < 1


def test_leaves_are_a_picture_of_edges() -> None:
    """Of flat leaves within [low, high], without a seam, and the same for the same seed."""
    image = textures.leaves(128, 5, 0.2, 0.1, 0.9)
    assert image.shape == (128, 128, 3) and 0.1 <= image.min() < 0.15 and 0.8 < image.max() <= 0.9
    assert np.array_equal(image, textures.leaves(128, 5, 0.2, 0.1, 0.9))
    assert not np.array_equal(image, textures.leaves(128, 6, 0.2, 0.1, 0.9))
    across = np.abs(np.diff(image, axis=1)).sum(-1)
    seam = np.abs(image[:, 0] - image[:, -1]).sum(-1)
    assert 0.3 < np.mean(across == 0) < 0.95  # within leaves nothing changes
    assert 0.6 < seam.mean() / across.mean() < 1.6
    grey = textures.leaves(64, 5, 0.2, 0.1, 0.9, 0.0)
    assert np.allclose(grey[..., 0], grey[..., 1]) and not np.allclose(image[..., 0], image[..., 1], atol=0.1)


def test_the_scale_of_leaves_is_their_feature() -> None:
    """Half as large leaves have edges twice as near to each other."""
    fine, coarse = (np.mean(np.diff(textures.leaves(256, 1, f), axis=1) != 0) for f in (0.1, 0.2))
    assert 1.5 < fine / coarse < 2.5
