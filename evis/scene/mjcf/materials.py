"""Adds materials of a MuJoCo model.

MuJoCo multiplies and adds display values, so its colours are taken as sRGB and made linear (IEC 61966-2-1). specular,
shininess and reflectance are not used.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.scene.images.colour import linear_from_srgb
from evis.scene.mjcf.textures import pixels, texture_of
from evis.scene.model import Material, Scene

LEAST = np.float32(0.01)
"""No surface reflects less, as the blackest paints: MuJoCo's black would send back nothing, which has no logarithm."""
_DEFAULT = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
"""rgba of a geom or tendon that says nothing; then its material's counts."""


def rgba_of(model: Any, own: np.ndarray, material: int) -> np.ndarray:
    """Reads the colour that MuJoCo shows of an element, sRGB and alpha, float32 [4]: its `own`, or else its material's.

    material: number of the material, -1 for none.
    """
    if material >= 0 and np.array_equal(own, _DEFAULT):
        return np.array(model.mat_rgba[material])
    return np.array(own, np.float32)


def material_of(scene: Scene, model: Any, geom: int, textures: dict[int, np.ndarray]) -> int | None:
    """Returns the index in scene.materials of a geom's material, made where it is not there yet; None for an invisible
    geom.

    textures: made before, by MuJoCo's number; materials share them.
    """
    number = int(model.geom_matid[geom])
    rgba = rgba_of(model, model.geom_rgba[geom], number)
    if rgba[3] == 0.0:
        return None
    base = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_MATERIAL, number) if number >= 0 else None
    name = base or (f"material{number}" if number >= 0 else "rgba")
    if number < 0 or not np.array_equal(rgba, model.mat_rgba[number]):
        name += " " + " ".join(f"{c:g}" for c in rgba[:3])
    for index, material in enumerate(scene.materials):
        if material.name == name:
            return index
    colour = linear_from_srgb(np.clip(rgba[:3], 0.0, 1.0))
    material = Material(name, np.maximum(colour, LEAST))
    if number >= 0:
        material.emission = (float(model.mat_emission[number]) * colour).astype(np.float32)
        if model.mat_roughness[number] >= 0:
            material.roughness = float(model.mat_roughness[number])
        material.metallic = max(0.0, float(model.mat_metallic[number]))
        texture = texture_of(model, geom)
        if texture >= 0:
            if texture not in textures:
                textures[texture] = np.maximum(pixels(model, texture), LEAST)
            material.texture = textures[texture]
    scene.materials.append(material)
    return len(scene.materials) - 1
