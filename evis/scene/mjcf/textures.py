"""Reads textures of a MuJoCo model, and where they lie on its geoms, as MuJoCo's renderer lays them.

Their values are sRGB (IEC 61966-2-1) and made linear, but those of a texture that the model's file states to be linear.

A 2d texture lies by coordinates (s, t) from the upper left corner of its image, t downwards: those of a mesh's own, or
of the shape. They are 0 to 1 over a plane and over each face of a box, over the square about a cylinder's end, and over
the azimuth and the height or parametric latitude of what is round, on a capsule for the side and each cap; on a plane
without end they count 2 m from the geom's origin, less a half. They are multiplied by `texrepeat`, and by the geom's
half-size in x and y where `texuniform`. Meshes without coordinates and height fields have the texture projected along
z. A cube texture is looked up by direction from the geom's origin, with primitives taken as those of half-size 1 unless
`texuniform`.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.scene.images.colour import linear_from_codes
from evis.scene.mjcf.cube_faces import cube_face, divide
from evis.scene.model import Mesh

_ROLES = (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA)
_TYPE = mujoco.mjtGeom
_UNSCALED = (_TYPE.mjGEOM_MESH, _TYPE.mjGEOM_SDF, _TYPE.mjGEOM_HFIELD, _TYPE.mjGEOM_PLANE)
"""Geoms that MuJoCo draws from vertices in metres; the others from primitives of half-size 1."""


def texture_of(model: Any, geom: int) -> int:
    """Returns the number of the colour texture of a geom, -1 for none."""
    material = int(model.geom_matid[geom])
    if material < 0:
        return -1
    return max(int(model.mat_texid[material, int(role)]) for role in _ROLES)


def pixels(model: Any, texture: int) -> np.ndarray:
    """Returns the pixels of a texture, linear float32 [h, w, 3]; of a cube or sky the six faces one below the other, a
    single one six times.
    """
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
    data = np.array(model.tex_data[start : start + height * width * channels]).reshape(height, width, channels)
    data = np.repeat(data[..., :1], 3, axis=-1) if channels < 3 else data[..., :3]
    if model.tex_colorspace[texture] != mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR:
        value = linear_from_codes(data)
    else:
        value = data.astype(np.float32) / np.float32(255.0)
    if model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D and height == width:
        value = np.tile(value, (6, 1, 1))
    return np.ascontiguousarray(value)


def add_coordinates(model: Any, geom: int, mesh: Mesh) -> None:
    """Gives the mesh of a geom its texture coordinates, float32 [F, 3, 2]; what has no texture needs none."""
    texture = texture_of(model, geom)
    if texture < 0:
        mesh.uv = None
    elif model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D:
        mesh.uv = _cube(model, geom, mesh, int(model.tex_width[texture]))
    elif _TYPE(model.geom_type[geom]) == _TYPE.mjGEOM_HFIELD or mesh.uv is None:
        mesh.uv = _planar(model, geom, mesh)
    else:
        mesh.uv = _repeated(model, geom, _of_shape(model, geom, mesh))


def half_size(model: Any, geom: int) -> np.ndarray:
    """Returns half a geom's size along its axes, float64 [3] m; 0 for a plane without end."""
    kind, size = _TYPE(model.geom_type[geom]), np.array(model.geom_size[geom], np.float64)
    if kind == _TYPE.mjGEOM_SPHERE:
        return np.full(3, size[0])
    if kind in (_TYPE.mjGEOM_CAPSULE, _TYPE.mjGEOM_CYLINDER):
        return size[[0, 0, 1]]
    return size


def _planar(model: Any, geom: int, mesh: Mesh) -> np.ndarray:
    material, size = int(model.geom_matid[geom]), half_size(model, geom)[:2]
    rate = 0.5 * np.array(model.mat_texrepeat[material], np.float64)
    if not model.mat_texuniform[material]:
        rate = np.where(size > 0, rate / np.where(size > 0, size, 1.0), rate)
    return (0.5 + rate * mesh.vertices[mesh.faces][..., :2]).astype(np.float32)


def _repeated(model: Any, geom: int, coordinates: np.ndarray) -> np.ndarray:
    """uv of coordinates (s, t)."""
    material, size = int(model.geom_matid[geom]), half_size(model, geom)[:2]
    repeat = np.array(model.mat_texrepeat[material], np.float64)
    repeat[repeat <= 0] = 1.0
    if model.mat_texuniform[material]:
        repeat *= np.where(size > 0, size, 1.0)
    endless = _TYPE(model.geom_type[geom]) == _TYPE.mjGEOM_PLANE and (size <= 0).any()
    s, t = np.moveaxis(repeat * coordinates - (0.5 if endless else 0.0), -1, 0)
    return np.stack((s, 1.0 - t), axis=-1).astype(np.float32)


def _of_shape(model: Any, geom: int, mesh: Mesh) -> np.ndarray:
    """The coordinates (s, t) of a shape before they are repeated, float64 [F, 3, 2]."""
    kind, size = _TYPE(model.geom_type[geom]), half_size(model, geom)
    at = mesh.vertices[mesh.faces] / np.where(size > 0, size, 1.0)
    middle = at.mean(axis=1)
    if kind == _TYPE.mjGEOM_PLANE:
        half = np.where(size[:2] > 0, 0.5, 0.0)  # finite: from the corner
        return half + np.array([0.5, -0.5]) * at[..., :2]
    if kind == _TYPE.mjGEOM_BOX:
        axes = np.array([[1, 2], [0, 2], [0, 1]])[np.argmax(np.abs(middle), axis=-1)]
        return 0.5 + np.array([0.5, -0.5]) * np.take_along_axis(at, axes[:, None], axis=-1)
    assert mesh.uv is not None
    s, t = mesh.uv[..., 0].astype(np.float64), 1.0 - mesh.uv[..., 1].astype(np.float64)
    if kind == _TYPE.mjGEOM_CYLINDER:
        end = np.ptp(at[..., 2], axis=-1) == 0
        return np.where(end[:, None, None], 0.5 + 0.5 * at[..., :2], np.stack((s, t), axis=-1))
    if kind in (_TYPE.mjGEOM_SPHERE, _TYPE.mjGEOM_ELLIPSOID, _TYPE.mjGEOM_CAPSULE):
        # A pole has the azimuth of the middle of each triangle there.
        pole = np.linalg.norm(at[..., :2], axis=-1) < 1e-6
        beside = np.where(pole, 0.0, s).sum(axis=1, keepdims=True) / (~pole).sum(axis=1, keepdims=True)
        s = np.where(pole, beside, s)
    if kind == _TYPE.mjGEOM_CAPSULE:
        beyond = (np.abs(at[..., 2]) - 1.0) * size[2] / size[0]
        latitude = np.arcsin(np.clip(beyond, 0.0, 1.0)) / (0.5 * np.pi)
        high = middle[:, 2:]
        t = np.where(high > 1.0, 1.0 - latitude, np.where(high < -1.0, latitude, 0.5 - 0.5 * at[..., 2]))
    return np.stack((s, t), axis=-1)


def _cube(model: Any, geom: int, mesh: Mesh, width: int) -> np.ndarray:
    """uv of a cube texture whose six faces lie one below the other (+x, -x, +y, -y, +z, -z).

    The mesh is divided where it goes from one face of the cube to another. Orientation within a face as in OpenGL's
    cube maps.
    """
    corners = divide(mesh, _directions(model, geom, mesh))
    face = cube_face(corners.mean(axis=1))
    x, y, z = np.moveaxis(corners, -1, 0)
    # (s, t) for each face, before the division by the major coordinate
    table = [(-z, -y), (z, -y), (x, z), (x, -z), (x, -y), (-x, -y)]
    s, t = (np.stack([row[i] for row in table])[face, np.arange(len(face))] for i in (0, 1))
    major = np.abs(np.take_along_axis(corners, (face // 2)[:, None, None], axis=-1)[..., 0])
    edge = 1.0 - 1.0 / width  # half a texel off the neighbouring face
    s, t = (0.5 + 0.5 * np.clip(v / np.maximum(major, 1e-9), -edge, edge) for v in (s, t))
    return np.stack((s, 1.0 - (face[:, None] + t) / 6.0), axis=-1).astype(np.float32)


def _directions(model: Any, geom: int, mesh: Mesh) -> np.ndarray:
    """In which a cube texture is looked up, float64 [F, 3, 3], of any length."""
    corners, size = mesh.vertices[mesh.faces].astype(np.float64), half_size(model, geom)
    uniform, kind = bool(model.mat_texuniform[model.geom_matid[geom]]), _TYPE(model.geom_type[geom])
    if kind in _UNSCALED:
        return corners * np.where(size > 0, size, 1.0) if uniform else corners
    if kind == _TYPE.mjGEOM_CAPSULE:
        # Its caps are halves of a sphere that begin where the side ends, and are scaled along z as that is.
        high = corners[..., 2].mean(axis=1, keepdims=True)
        cap, end = np.abs(high) > size[2], np.sign(high) * size[2]
        corners[..., 2] = np.where(cap, end + (corners[..., 2] - end) * (size[2] / size[0]), corners[..., 2])
    return corners if uniform else corners / size
