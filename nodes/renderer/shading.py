"""Light on what a `Visibility` sees: materials, lights and shadow casters of a scene on the device."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from nodes.renderer import shading_kernels
from nodes.renderer.geometry import is_static
from nodes.renderer.ggx import alpha_of, is_plain
from nodes.renderer.lights import LightSet, check_colour
from nodes.renderer.lights_sky import make_sky
from nodes.renderer.occlusion import Occluders
from nodes.renderer.poses import Frames
from nodes.renderer.textures import pack
from nodes.renderer.visibility import Visibility, store

CACHED_LIGHTS = 32
"""Most lights, one bit each, under which still surfaces are remembered."""

make_shade = cache(shading_kernels.make_shade)


class Shading:
    """Fills a radiance image from a visibility's z-buffer.

    Call `update` with the frames that the visibility was updated with, then `shade`. While the camera, all lights and
    the still bodies stay where they are, the light on still surfaces is remembered, and only what moving casters do to
    it is traced; the image is the same, bit for bit. Of flickering lights it is remembered only whom they reach.

    A material of roughness 1 without metal is plain diffuse, any other the GGX of glTF 2.0; emission, lights' `colour`
    and the sky are as in `evis.scene.model`. Area lights are unseen themselves, cast soft shadows by `light_samples`
    rays with random numbers that belong to the surface (none where nothing can be in the way), and need materials that
    glow in their place to be seen. Surfaces that emit light nothing else, and nothing hides the sky.
    """

    def __init__(self, visibility: Visibility, half: bool = False, light_samples: int = 16) -> None:
        scene, geometry = visibility.scene, visibility.geometry
        self.visibility, self.scene, self.device = visibility, scene, visibility.device
        self.pixel: Any = wp.vec3h if half else wp.vec3f
        self.normals = visibility.put(geometry.normals, wp.vec3)
        self._still = geometry.static & is_static(scene, visibility.camera_body)
        self.surfaces, textured = self._make_surfaces()
        self.lights = LightSet(visibility, light_samples)
        gloss = any(not is_plain(scene.materials[i.material]) for i in scene.instances)
        self.sky = make_sky(visibility, gloss)
        shadows = any(light.shadows for light in scene.lights) and len(geometry.triangles) > 0
        self.occluders = Occluders(visibility, self._still, shadows)
        self._cached = cached = self._cacheable()
        shape = visibility.shape if cached else (0, 0, 0)
        self._cached_triangle = wp.full(shape, -1, dtype=wp.int32, device=self.device)
        self._cached_lit = wp.zeros(shape, dtype=wp.uint32, device=self.device)
        self._cached_colour = wp.zeros(shape, dtype=wp.vec3, device=self.device)
        self._basis: tuple[np.ndarray, ...] | None = None
        bands = len(visibility.bands.rows)
        self._not_finite = wp.zeros(bands, dtype=wp.int32, device=self.device)
        self._clipped = wp.zeros(bands, dtype=wp.int32, device=self.device)
        kinds = self.lights.kinds
        self._kernel = make_shade(
            textures=textured,
            smooth=geometry.smooth is not None,
            directional="directional" in kinds,
            point="point" in kinds,
            spot="spot" in kinds,
            area="area" in kinds,
            gloss=gloss,
            mapped=scene.environment_map is not None,
            flicker=self.lights.flickers,
            shadows=shadows,
            trees=self.occluders.trees,
            cache=cached,
            half=half,
        )

    def update(self, frames: Frames) -> None:
        """Lights to the camera frame; what was remembered is forgotten if the camera or a still body has moved."""
        vectors = self.lights.place(frames)
        store(self.sky.camera, frames.camera)
        self.occluders.update(frames)
        if self._cached:
            still = np.flatnonzero(self._still)
            basis = (frames.rotation[:, still], frames.translation[:, still], vectors)
            if self._basis is None or not all(map(np.array_equal, basis, self._basis)):
                self._cached_triangle.fill_(-1)
                self._basis = basis

    def set_time(self, t_ns: int) -> bool:
        """Flickering lights as they are at an instant; True where one is not as it was."""
        return self.lights.set_time(t_ns)

    def shade(self, radiance: wp.array) -> tuple[int, int]:
        """Write [E, H, W] radiance. Gives how many pixels were not finite, and how many were clipped to float16."""
        v = self.visibility
        self._not_finite.zero_()
        self._clipped.zero_()
        shared = [v.packed, v.vertices, v.rotation, v.translation, self.surfaces, self.lights.kernel]
        shared += [self.sky, self.occluders.casters]
        shared += [self._cached_triangle, self._cached_lit, self._cached_colour]
        shared += [radiance, self._not_finite, self._clipped]
        envs, _, width = v.shape
        bands = {row0: k for k, (row0, _) in enumerate(v.bands.rows)}

        def arguments(row0: int, row1: int) -> tuple[tuple[int, ...], list[Any]]:
            return (envs, row1 - row0, width // v.span), [v.view, row0, bands[row0], v.span, *shared]

        v.bands.launch(self._kernel, arguments, self.device)
        return int(self._not_finite.numpy().sum()), int(self._clipped.numpy().sum())

    def _cacheable(self) -> bool:
        """Whether some light on some surface can stay the same while something moves."""
        lights = self.scene.lights
        still = all(is_static(self.scene, light.body) for light in lights) and len(lights) <= CACHED_LIGHTS
        return still and bool(self._still.any())

    def _make_surfaces(self) -> tuple[Any, bool]:
        """The materials, and whether any is textured."""
        scene, geometry, put = self.scene, self.visibility.geometry, self.visibility.put
        surfaces = shading_kernels.Surfaces()
        for material in scene.materials:
            check_colour(scene, f"material '{material.name}' albedo", material.albedo)
            check_colour(scene, f"material '{material.name}' emission", material.emission)
            if not 0 <= material.roughness <= 1 or not 0 <= material.metallic <= 1:
                raise ValueError(
                    f"scene {scene.name}: material '{material.name}' has roughness {material.roughness} and metallic "
                    f"{material.metallic}; both must be 0 ... 1"
                )
        none2, none3 = np.zeros((0, 2)), np.zeros((0, 3))
        surfaces.instance, surfaces.triangles = self.visibility.triangle_instance, self.visibility.triangles
        surfaces.normals = self.normals
        surfaces.uv = put(none2 if geometry.uv is None else geometry.uv, wp.vec2)
        surfaces.smooth = put(none3 if geometry.smooth is None else geometry.smooth, wp.vec3)
        surfaces.material = put(np.array([i.material for i in scene.instances], np.int32), wp.int32)
        surfaces.albedo = put(np.array([m.albedo for m in scene.materials]).reshape(-1, 3), wp.vec3)
        surfaces.emission = put(np.array([m.emission for m in scene.materials]).reshape(-1, 3), wp.vec3)
        gloss = [(alpha_of(m), m.metallic) for m in scene.materials]
        surfaces.gloss = put(np.array(gloss).reshape(-1, 2), wp.vec2)
        surfaces.textures, textured = pack(scene, put)
        return surfaces, textured
