"""Shapes of a scene file as meshes."""

from __future__ import annotations

import numpy as np

from evis.scene import shapes
from evis.scene.model import Mesh
from evis.scene.reader import Fields

KINDS = ("box", "sphere", "ellipsoid", "cylinder", "capsule", "plane", "disk", "mesh")


def read_shape(fields: Fields) -> Mesh:
    """The mesh of one entry of `shapes:`; lengths in metres, full sizes and not halves."""
    kind = fields.text("shape", choices=KINDS)
    if kind == "box":
        return shapes.box(fields.vector("size", 3, above=0.0))
    if kind == "ellipsoid":
        return shapes.ellipsoid(fields.vector("radii", 3, above=0.0))
    if kind == "plane":
        return shapes.plane(fields.vector("size", 2, above=0.0), fields.vector("repeat", 2, [1, 1], above=0.0))
    if kind == "mesh":
        return _mesh(fields)
    radius = fields.number("radius", above=0.0)
    if kind == "sphere":
        return shapes.sphere(radius)
    if kind == "disk":
        return shapes.disk(radius)
    height = fields.number("height", above=0.0)
    return shapes.cylinder(radius, height) if kind == "cylinder" else shapes.capsule(radius, height)


def _mesh(fields: Fields) -> Mesh:
    vertices, faces = (_triples(fields, key) for key in ("vertices", "faces"))
    if len(vertices) < 3 or len(faces) < 1:
        raise fields.error("vertices", "must be at least three, with at least one face")
    if not np.array_equal(faces, faces.astype(np.int64)) or faces.min() < 0 or faces.max() >= len(vertices):
        raise fields.error("faces", f"must be whole numbers from 0 to {len(vertices) - 1}, the indices of vertices")
    return shapes.triangles(vertices, faces)


def _triples(fields: Fields, key: str) -> np.ndarray:
    try:
        value = np.array([[float(v) for v in row] for row in fields.raw(key)], np.float64)
    except (TypeError, ValueError):
        value = np.zeros(0)
    if value.ndim != 2 or value.shape[1] != 3 or not np.isfinite(value).all():
        raise fields.error(key, "must be a list of [a, b, c] with finite numbers")
    return value
