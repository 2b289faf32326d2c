"""Brings the materials of a scene to the device, as the kernels of shading read them."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.renderer.lights.lights import check_colour
from nodes.renderer.materials.ggx import alpha_of
from nodes.renderer.raster.surface_kernels import Surfaces
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.textures.textures import pack


def make_surfaces(visibility: Visibility, normals: wp.array) -> tuple[Any, bool]:
    """Makes the arrays of a scene's materials, and tells whether any is textured.

    normals: vec3 [T], of the triangles' planes. Raises ValueError for a material that is not usable.
    """
    scene, geometry, put = visibility.scene, visibility.geometry, visibility.put
    surfaces = Surfaces()
    for material in scene.materials:
        check_colour(scene, f"material '{material.name}' albedo", material.albedo)
        check_colour(scene, f"material '{material.name}' emission", material.emission)
        if not 0 <= material.roughness <= 1 or not 0 <= material.metallic <= 1:
            raise ValueError(
                f"scene {scene.name}: material '{material.name}' has roughness {material.roughness} and metallic "
                f"{material.metallic}; both must be 0 ... 1"
            )
    none2, none3 = np.zeros((0, 2)), np.zeros((0, 3))
    surfaces.instance, surfaces.triangles = visibility.triangle_instance, visibility.triangles
    surfaces.normals = normals
    surfaces.uv = put(none2 if geometry.uv is None else geometry.uv, wp.vec2)
    surfaces.smooth = put(none3 if geometry.smooth is None else geometry.smooth, wp.vec3)
    surfaces.tint = put(none3 if geometry.tint is None else geometry.tint, wp.vec3)
    surfaces.material = put(np.array([i.material for i in scene.instances], np.int32), wp.int32)
    surfaces.albedo = put(np.array([m.albedo for m in scene.materials]).reshape(-1, 3), wp.vec3)
    surfaces.emission = put(np.array([m.emission for m in scene.materials]).reshape(-1, 3), wp.vec3)
    gloss = [(alpha_of(m), m.metallic) for m in scene.materials]
    surfaces.gloss = put(np.array(gloss).reshape(-1, 2), wp.vec2)
    surfaces.textures, textured = pack(scene, put)
    return surfaces, textured
