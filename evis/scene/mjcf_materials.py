"""Materials and textures of a MuJoCo model.

MuJoCo multiplies and adds display values, so its colours and textures are taken as sRGB and made linear (IEC
61966-2-1); the values of a texture marked linear are taken as they are. specular, shininess and reflectance are not
used.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.scene.colour import linear_from_srgb
from evis.scene.model import Material, Mesh, Scene

_DEFAULT = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
"""rgba of a geom that says nothing; then its material's counts."""
_ROLES = (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA)


def texture_of(model: Any, geom: int) -> int:
    """Number of the colour texture of a geom, -1 for none."""
    material = int(model.geom_matid[geom])
    if material < 0:
        return -1
    return max(int(model.mat_texid[material, int(role)]) for role in _ROLES)


def texture_kind(model: Any, geom: int) -> str:
    """`cube`, `2d`, or empty for a geom without a texture."""
    texture = texture_of(model, geom)
    if texture < 0:
        return ""
    return "2d" if model.tex_type[texture] == mujoco.mjtTexture.mjTEXTURE_2D else "cube"


def repeats(model: Any, geom: int) -> np.ndarray:
    """texrepeat [2] of a geom's material."""
    material = int(model.geom_matid[geom])
    return np.array(model.mat_texrepeat[material], np.float64) if material >= 0 else np.ones(2)


def material_of(scene: Scene, model: Any, geom: int) -> int | None:
    """Index in scene.materials of a geom's material, made where it is not there yet; None for an invisible geom."""
    number, own = int(model.geom_matid[geom]), np.array(model.geom_rgba[geom], np.float32)
    rgba = np.array(model.mat_rgba[number]) if number >= 0 and np.array_equal(own, _DEFAULT) else own
    if rgba[3] == 0.0:
        return None
    base = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_MATERIAL, number) if number >= 0 else None
    name = base or (f"material{number}" if number >= 0 else "rgba")
    if number < 0 or not np.array_equal(rgba, model.mat_rgba[number]):
        name += " " + " ".join(f"{c:g}" for c in rgba[:3])
    for index, material in enumerate(scene.materials):
        if material.name == name:
            return index
    albedo = linear_from_srgb(np.clip(rgba[:3], 0.0, 1.0))
    material = Material(name, albedo)
    if number >= 0:
        material.emission = (float(model.mat_emission[number]) * albedo).astype(np.float32)
        if model.mat_roughness[number] >= 0:
            material.roughness = float(model.mat_roughness[number])
        material.metallic = max(0.0, float(model.mat_metallic[number]))
        texture = texture_of(model, geom)
        if texture >= 0:
            material.texture = _pixels(model, texture)
    scene.materials.append(material)
    return len(scene.materials) - 1


def _pixels(model: Any, texture: int) -> np.ndarray:
    """float32 [h, w, 3], linear; the six faces of a cube texture one below the other."""
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
    data = np.array(model.tex_data[start : start + height * width * channels]).reshape(height, width, channels)
    value = np.repeat(data, 3, axis=-1) if channels < 3 else data[..., :3]
    value = value[..., :3].astype(np.float32) / 255.0
    linear = model.tex_colorspace[texture] == mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR
    return np.ascontiguousarray(value if linear else linear_from_srgb(value))


def cube_coordinates(model: Any, geom: int, mesh: Mesh) -> np.ndarray:
    """uv [F, 3, 2] of a cube texture whose six faces lie one below the other (+x, -x, +y, -y, +z, -z).

    Each triangle takes the face of the cube that it looks at most; directions are scaled by the mesh's extent, so
    that a box shows every face whole. Orientation within a face as in OpenGL's cube maps.
    """
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    corners /= np.abs(corners).max(axis=(0, 1))
    middle = corners.mean(axis=1)
    axis = np.argmax(np.abs(middle), axis=-1)
    negative = np.take_along_axis(middle, axis[:, None], -1)[:, 0] < 0
    x, y, z = np.moveaxis(corners, -1, 0)
    # (s, t) for each face, before the division by the major coordinate
    table = [(-z, -y), (z, -y), (x, z), (x, -z), (x, -y), (-x, -y)]
    face = 2 * axis + negative
    s, t = (np.stack([row[i] for row in table])[face, np.arange(len(face))] for i in (0, 1))
    major = np.abs(np.take_along_axis(corners, axis[:, None, None], -1)[..., 0])
    edge = 1.0 - 1.0 / int(model.tex_width[texture_of(model, geom)])  # half a texel off the neighbouring face
    s, t = (0.5 + 0.5 * np.clip(v / np.maximum(major, 1e-9), -edge, edge) for v in (s, t))
    return np.stack((s, 1.0 - (face[:, None] + t) / 6.0), axis=-1).astype(np.float32)
