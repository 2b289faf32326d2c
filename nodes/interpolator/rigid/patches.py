"""Divides surfaces into pieces whose shading has no step inside: triangles that meet without a crease, seen from one
side.

What is fetched from a keyframe must not mix two such pieces: neither two bodies at a silhouette nor two sides of a box
at an edge, nor the front and the back of a blade that has turned over.
"""

from __future__ import annotations

import numpy as np

from evis.geometry.triangles import area_vectors
from evis.scene.model import Mesh, Scene
from nodes.renderer.geometry.triangles import Geometry

SIDES = 2
"""Patches of a piece of surface: its front and its back."""
CREASE = np.cos(np.deg2rad(15.0))
"""Cosine of the angle between shading normals from which on an edge is a crease; a sphere of 24 segments has none."""


def patches_of(scene: Scene) -> tuple[np.ndarray, int]:
    """Finds the patch int32 [T] of every triangle of all instances, numbered from 1 (0: the sky), and their count.

    Patches of different instances are different.
    """
    known: dict[int, np.ndarray] = {}
    parts, count = [], 1
    for instance in scene.instances:
        mesh = instance.mesh
        if id(mesh) not in known:
            known[id(mesh)] = mesh_patches(mesh)
        own = known[id(mesh)]
        parts.append(own + count)
        count += int(own.max(initial=-1)) + 1
    return (np.concatenate(parts) if parts else np.zeros(0, np.int64)).astype(np.int32), count


def pieces_of(scene: Scene, triangle_instance: np.ndarray) -> tuple[np.ndarray, int]:
    """Finds of every triangle its body, the world's index being their number, and the patch of its front, int32 [T, 2];
    that of its back is the next one. Gives also the count of patches. triangle_instance: int [T]."""
    patch, count = patches_of(scene)
    patch, count = SIDES * patch, SIDES * count
    bodies = len(scene.bodies)
    on = np.array([i.body if i.body >= 0 else bodies for i in scene.instances], np.int32)
    return np.stack([on[triangle_instance], patch], axis=-1).reshape(-1, 2), count


def moving_patches(pieces: np.ndarray, count: int, geometry: Geometry, camera_rests: bool) -> np.ndarray:
    """Tells which of all patches may ever move against the camera, bool [count]; pieces, count: of `pieces_of`."""
    if not camera_rests:
        return np.ones(count, bool)
    moving = np.zeros(count, bool)
    fronts = pieces[~geometry.static[geometry.triangle_instance], 1]
    for side in range(SIDES):
        moving[fronts + side] = True
    return moving


def neighbours_of(scene: Scene) -> np.ndarray:
    """Finds the triangles of the same patch int32 [T, 3] across the edges of every triangle of all instances: opposite
    to its first corner, to its second and to its third one, -1 = none."""
    known: dict[int, np.ndarray] = {}
    parts, count = [], 0
    for instance in scene.instances:
        mesh = instance.mesh
        if id(mesh) not in known:
            known[id(mesh)] = mesh_neighbours(mesh)[:, [1, 2, 0]]
        own = known[id(mesh)]
        parts.append(np.where(own >= 0, own + count, -1))
        count += len(own)
    return (np.concatenate(parts) if parts else np.zeros((0, 3), np.int64)).astype(np.int32)


def mesh_patches(mesh: Mesh) -> np.ndarray:
    """Finds the patch int64 [F] of each face, numbered from 0: faces joined over edges that are no crease."""
    beside = mesh_neighbours(mesh)
    if not len(beside):
        return np.zeros(0, np.int64)
    face, _ = np.nonzero(beside >= 0)
    pairs = np.stack((face, beside[beside >= 0]), axis=1)
    label = np.arange(len(beside))
    # Each round takes over the smallest label of the neighbours and then follows labels to their own.
    while True:
        before = label.copy()
        low = np.minimum(label[pairs[:, 0]], label[pairs[:, 1]])
        for side in (0, 1):
            np.minimum.at(label, label[pairs[:, side]], low)
        while not np.array_equal(label, label[label]):
            label = label[label]
        if np.array_equal(label, before):
            return np.unique(label, return_inverse=True)[1].reshape(-1)


def _welded(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Numbers the corners of faces by vertices that differ in place: a mesh may have several of the same, with other
    texture coordinates."""
    points = np.ascontiguousarray(vertices, np.float32) + np.float32(0.0)
    keys = points.view([("x", np.float32), ("y", np.float32), ("z", np.float32)]).reshape(-1)
    return np.unique(keys, return_inverse=True)[1].reshape(-1)[faces]


def mesh_neighbours(mesh: Mesh) -> np.ndarray:
    """Finds the face int64 [F, 3] across each edge of each face, from its first corner to the second and so on, where
    the shading normal does not jump there; -1 = none."""
    faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3)
    count = len(faces)
    beside = np.full((count, 3), -1)
    if not count:
        return beside
    faces = _welded(np.asarray(mesh.vertices), faces)
    corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces, np.int64).reshape(-1, 3)]
    flat = area_vectors(corners)
    normal = np.repeat(flat[:, None], 3, axis=1)
    if mesh.normals is not None:
        given = np.asarray(mesh.normals, np.float64).reshape(count, 3, 3)
        normal = np.where(np.any(given, axis=-1, keepdims=True), given, normal)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    ends, sides = np.array([[0, 1], [1, 2], [2, 0]]), []
    for end in ends:
        a, b = faces[:, end[0]], faces[:, end[1]]
        swap = (a > b)[:, None]
        first, second = normal[:, end[0]], normal[:, end[1]]
        sides.append((np.minimum(a, b), np.maximum(a, b), np.where(swap, second, first), np.where(swap, first, second)))
    low, high, at_low, at_high = (np.concatenate(part) for part in zip(*sides))
    face = np.tile(np.arange(count), 3)
    order = np.lexsort((high, low))
    same = (low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1])
    left, right = order[:-1][same], order[1:][same]
    smooth = ((at_low[left] * at_low[right]).sum(1) >= CREASE) & ((at_high[left] * at_high[right]).sum(1) >= CREASE)
    for here, there in ((left[smooth], right[smooth]), (right[smooth], left[smooth])):
        beside[face[here], here // count] = face[there]
    return beside
