"""Adds geoms of a MuJoCo model as instances with meshes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from evis.geometry import se3
from evis.geometry.triangles import area_vectors
from evis.scene.mesh import shapes
from evis.scene.mesh.normals import crease_normals
from evis.scene.mjcf.materials import material_of
from evis.scene.mjcf.textures import add_coordinates
from evis.scene.model import Instance, Mesh, Scene

GROUPS = (0, 1, 2)
"""Geom groups that are drawn."""
CREASE = float(np.arccos(0.8))
"""Angle from which on MuJoCo takes an edge of a mesh for sharp [rad]."""
ASTRAY = 0.1
"""Cosine between a normal and its triangle's own, up to which it is none to shade with."""
_TYPE = mujoco.mjtGeom


def add_geom(scene: Scene, model: Any, geom: int, textures: dict[int, np.ndarray] | None = None) -> int:
    """Adds geom number `geom` and its material too where the scene lacks it; nothing for one that is invisible.

    textures: of materials made before, by MuJoCo's number. Returns the bytes of what was made.
    """
    material = material_of(scene, model, geom, textures if textures is not None else {})
    if material is None:
        return 0
    body = int(model.geom_bodyid[geom]) - 1
    kind = _TYPE(model.geom_type[geom])
    mesh = _mesh(model, geom, kind)
    if mesh is None:
        scene.left_out.append(f"geom {geom} of type {kind.name.removeprefix('mjGEOM_').lower()} is not drawn")
        return 0
    mesh = _laid(model, geom, mesh)
    owner = scene.bodies[body].name if body >= 0 else "world"
    label = kind.name.removeprefix("mjGEOM_").lower()
    alone = body >= 0 and np.count_nonzero(model.geom_bodyid == body + 1) == 1
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or (owner if alone else f"{owner}_{label}{geom}")
    pose = se3.make_pose(model.geom_pos[geom], se3.from_mujoco(model.geom_quat[geom]))
    # A robot's links are told apart; what stands in the world is what it is called.
    scene.instances.append(Instance(name, body, mesh, material, pose, owner if body >= 0 else name))
    return mesh.nbytes


def _laid(model: Any, geom: int, mesh: Mesh) -> Mesh:
    """A mesh with texture coordinates, also when it is made finer."""
    add_coordinates(model, geom, mesh)
    if (shape := mesh.round) is not None:
        mesh.round = replace(shape, finer=lambda n: _laid(model, geom, shape.finer(n)))
    return mesh


def _mesh(model: Any, geom: int, kind: Any) -> Mesh | None:
    size = np.array(model.geom_size[geom], np.float64)
    if kind == _TYPE.mjGEOM_PLANE:
        return _plane(model, geom, size)
    if kind == _TYPE.mjGEOM_SPHERE:
        return shapes.sphere(size[0])
    if kind == _TYPE.mjGEOM_CAPSULE:
        return shapes.capsule(size[0], 2 * size[1])
    if kind == _TYPE.mjGEOM_ELLIPSOID:
        return shapes.ellipsoid(size)
    if kind == _TYPE.mjGEOM_CYLINDER:
        return shapes.cylinder(size[0], 2 * size[1])
    if kind == _TYPE.mjGEOM_BOX:
        return shapes.box(2 * size)
    if kind in (_TYPE.mjGEOM_MESH, _TYPE.mjGEOM_SDF):
        return _asset(model, int(model.geom_dataid[geom]))
    if kind == _TYPE.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))
    return None


def _plane(model: Any, geom: int, size: np.ndarray) -> Mesh:
    """A plane that is infinite in MuJoCo (size 0) ends at ten times the model's extent, at least 20 m off."""
    far = max(20.0, 10.0 * float(model.stat.extent))
    half = np.where(size[:2] > 0, size[:2], far)
    return shapes.plane(2 * half, cells=16)


def _asset(model: Any, mesh: int) -> Mesh:
    vertices = _rows(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum, mesh)
    faces = _rows(model.mesh_face, model.mesh_faceadr, model.mesh_facenum, mesh)
    corners = _rows(model.mesh_facenormal, model.mesh_faceadr, model.mesh_facenum, mesh)
    normals = _rows(model.mesh_normal, model.mesh_normaladr, model.mesh_normalnum, mesh)[corners]
    if np.array_equal(corners, faces) and _astray(vertices, faces, normals):
        normals = crease_normals(vertices, faces, CREASE)
    uv = None
    if model.mesh_texcoordadr[mesh] >= 0:
        corners = _rows(model.mesh_facetexcoord, model.mesh_faceadr, model.mesh_facenum, mesh)
        uv = _rows(model.mesh_texcoord, model.mesh_texcoordadr, model.mesh_texcoordnum, mesh)[corners]
        # MuJoCo counts v downwards from the top of the image
        uv = np.stack((uv[..., 0], 1.0 - uv[..., 1]), axis=-1).astype(np.float32)
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), uv, normals.astype(np.float32))


def _astray(vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray) -> bool:
    """Whether MuJoCo made normals [F, 3, 3] of a mesh with sharp edges: it keeps one for each vertex, which is that of
    one side of an edge, or, at a corner, what rounding leaves. Means over all faces (`smoothnormal`) are not."""
    points = np.asarray(vertices, np.float64)[faces]
    area = area_vectors(points)
    turned = np.einsum("fkx,fx->fk", normals, area) <= ASTRAY * np.linalg.norm(area, axis=-1)[:, None]
    turned &= (area != 0).any(axis=-1)[:, None]
    if not turned.any():
        return False
    means = np.zeros((len(vertices), 3))
    np.add.at(means, faces, area[:, None])
    means /= np.maximum(np.linalg.norm(means, axis=-1, keepdims=True), 1e-300)
    return bool(np.einsum("tx,tx->t", normals[turned], means[faces][turned]).min() < 0.99)


def _rows(values: np.ndarray, starts: np.ndarray, counts: np.ndarray, i: int) -> np.ndarray:
    return np.array(values[starts[i] : starts[i] + counts[i]])


def _height_field(model: Any, field: int) -> Mesh:
    """The upper surface; rows of the data lie along y, columns along x."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    height = np.array(model.hfield_data[start : start + rows * columns]).reshape(rows, columns)
    sx, sy, top, _ = model.hfield_size[field]
    y, x = np.meshgrid(np.linspace(-sy, sy, rows), np.linspace(-sx, sx, columns), indexing="ij")
    uv = np.stack((0.5 + 0.5 * x / sx, 0.5 + 0.5 * y / sy), axis=-1)
    return shapes.grid(np.stack((x, y, top * height), axis=-1), uv)
