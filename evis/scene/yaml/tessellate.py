"""Makes shapes of a scene file into meshes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.mesh import shapes, solids
from evis.scene.model import Mesh
from evis.scene.own.drawn_file import drawn_file
from evis.scene.yaml.reader import LARGEST, Fields

KINDS = ("box", "sphere", "ellipsoid", "cylinder", "capsule", "torus", "rock", "plane", "disk", "mesh")
Recipe = tuple[Callable[..., Mesh], tuple[Any, ...]]


def read_shape(fields: Fields, made: dict[Any, Mesh] | None = None) -> Mesh:
    """Makes the mesh of one entry of `shapes:`; lengths in metres, full sizes and not halves.

    made: meshes of shapes read before; the same shape is the same Mesh, so that readers may work on it once.
    """
    make, arguments = _recipe(fields)
    key = (make, *(np.asarray(a).tobytes() for a in arguments))
    if made is None or key not in made:
        try:
            mesh = make(*arguments)
        except ValueError as error:
            raise fields.error(None, f"cannot be made: {error}") from None
        if made is None:
            return mesh
        made[key] = mesh
    return made[key]


def _recipe(fields: Fields) -> Recipe:
    kind = fields.text("shape", choices=KINDS)
    if kind == "box":
        size, edge = fields.vector("size", 3, above=0.0), fields.number("edge", 0.0, minimum=0.0)
        tile = fields.number("tile", 0.0, minimum=0.0)
        if edge > 0 and tile > 0:
            raise fields.error("tile", "and edge are given; leave one out")
        return (shapes.rounded_box, (size, edge)) if edge > 0 else (shapes.box, (size, tile))
    if kind == "ellipsoid":
        return shapes.ellipsoid, (fields.vector("radii", 3, above=0.0),)
    if kind == "plane":
        size, cells = fields.vector("size", 2, above=0.0), fields.whole("cells", 8, minimum=1, maximum=512)
        if fields.has("tile") and fields.has("repeat"):
            raise fields.error("tile", "and repeat are given; leave one out")
        tiles = size / fields.number("tile", above=0.0) if fields.has("tile") else fields.vector("repeat", 2, [1, 1])
        return shapes.plane, (size, tiles, cells)
    if kind == "mesh":
        return shapes.triangles, _triangles(fields)
    radius = fields.number("radius", above=0.0)
    if kind == "sphere":
        return shapes.sphere, (radius,)
    if kind == "disk":
        return shapes.disk, (radius,)
    if kind == "torus":
        return solids.torus, (radius, fields.number("tube", above=0.0))
    if kind == "rock":
        return solids.rock, (radius, fields.fraction("rough", 0.4), fields.whole("seed", 0, maximum=(1 << 32) - 1))
    height = fields.number("height", above=0.0)
    return (shapes.cylinder if kind == "cylinder" else shapes.capsule), (radius, height)


def _triangles(fields: Fields) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = (_triples(fields, key) for key in ("vertices", "faces"))
    if len(vertices) < 3 or len(faces) < 1:
        raise fields.error("vertices", "must be at least three, with at least one face")
    if not np.array_equal(faces, np.floor(faces)) or faces.min() < 0 or faces.max() >= len(vertices):
        raise fields.error("faces", f"must be whole numbers from 0 to {len(vertices) - 1}, the indices of vertices")
    return vertices, faces


def _triples(fields: Fields, key: str) -> np.ndarray:
    try:
        value = np.array([[float(v) for v in row] for row in fields.raw(key)], np.float64)
    except (TypeError, ValueError):
        value = np.zeros(0)
    if value.ndim != 2 or value.shape[1] != 3 or not (np.abs(value) <= LARGEST).all():
        raise fields.error(key, f"must be a list of [a, b, c] with finite numbers up to {LARGEST:g}")
    return value


def read_own(fields: Fields, home: Path, textures: bool, made: dict[Any, Any]) -> list[Any] | None:
    """Reads the mesh of the user's that takes the place of a shape, scaled into its box; None where none does.

    home: the scene's folder.
    """
    path = drawn_file(fields, "shape", home)
    if path is None:
        return None
    from evis.scene.own.mesh import fitted, read_mesh

    key = path, textures
    if key not in made:
        try:
            made[key] = read_mesh(path, textures)
        except SceneError as error:
            raise fields.error("folder", f"names what cannot be used: {error}; mend it or take it away") from None
    shape = read_shape(fields, made)
    fit = *key, shape.vertices.tobytes()
    if fit not in made:
        made[fit] = fitted(made[key], shape)
    parts: list[Any] = made[fit]
    return parts


def read_parts(fields: Fields, folders: Folders, textures: bool, made: dict[Any, Any]) -> list[Any]:
    """Loads the meshes of the file that an entry of `shapes:` names, each with its material.

    folders: where the scene file lies, and from where the files that the mesh names may come.
    """
    from evis.scene.mesh import files as meshfile

    fields.text("shape", choices=("mesh",))
    name = fields.text("file")
    path = folders.home / name
    if not path.is_file():
        raise fields.error("file", f"names {name}, which is not in {folders.home or '.'}")
    scale = fields.raw("scale", 1.0)
    size = fields.vector_of("scale", scale if isinstance(scale, list) else [scale] * 3, 3)
    if not size.all():
        raise fields.error("scale", "is zero along an axis, which leaves no volume")
    up = fields.text("up", choices=("y", "z")) if fields.has("up") else None
    crease = fields.angle("crease", meshfile.CREASE)
    key = (path, size.tobytes(), up, crease)
    if key not in made:
        try:
            up_is_y = None if up is None else up == "y"
            made[key] = meshfile.load_parts(path, size, up_is_y, crease, textures, folders.beside(path))
        except SceneError as error:
            raise fields.error("file", f"cannot be used: {error}") from None
    return made[key]
