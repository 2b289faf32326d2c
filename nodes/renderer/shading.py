"""Light on what a `Visibility` sees: materials, lights and shadow casters of a scene on the device."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from evis.scene.model import WORLD, Light, Mesh, Scene
from nodes.renderer import shading_kernels
from nodes.renderer.geometry import is_static
from nodes.renderer.poses import Frames
from nodes.renderer.visibility import Visibility, store

CACHED_LIGHTS = 32
"""Most lights, one bit each, under which still surfaces are remembered."""

KINDS = {"directional": int(shading_kernels.DIRECTIONAL), "point": int(shading_kernels.POINT)}

make_shade = cache(shading_kernels.make_shade)


class Shading:
    """Fills a radiance image from a visibility's z-buffer.

    Call `update` with the frames that the visibility was updated with, then `shade`. While the camera, all lights and
    the still bodies stay where they are, the light on still surfaces is remembered, and only what moving casters do to
    it is traced; the image is the same, bit for bit.
    """

    def __init__(self, visibility: Visibility, half: bool = False) -> None:
        scene, geometry = visibility.scene, visibility.geometry
        self.visibility, self.scene, self.device = visibility, scene, visibility.device
        self.pixel: Any = wp.vec3h if half else wp.vec3f
        self.normals = visibility.put(geometry.normals, wp.vec3)
        self._still = geometry.static & is_static(scene, visibility.camera_body)
        self.surfaces, textured = self._make_surfaces()
        self.lights = self._make_lights()
        self._blas: dict[int, wp.Mesh] = {}
        shadows = any(light.shadows for light in scene.lights) and len(geometry.triangles) > 0
        self.casters = self._make_casters(shadows)
        self._cached = cached = self._cacheable()
        shape = visibility.shape if cached else (0, 0, 0)
        self._cached_triangle = wp.full(shape, -1, dtype=wp.int32, device=self.device)
        self._cached_lit = wp.zeros(shape, dtype=wp.uint32, device=self.device)
        self._cached_colour = wp.zeros(shape, dtype=wp.vec3, device=self.device)
        self._basis: tuple[np.ndarray, ...] | None = None
        bands = len(visibility.bands.rows)
        self._not_finite = wp.zeros(bands, dtype=wp.int32, device=self.device)
        self._clipped = wp.zeros(bands, dtype=wp.int32, device=self.device)
        kinds = {light.kind for light in scene.lights}
        self._kernel = make_shade(
            textures=textured,
            smooth=geometry.smooth is not None,
            directional="directional" in kinds,
            point="point" in kinds,
            shadows=shadows,
            cache=cached,
            half=half,
        )

    def update(self, frames: Frames) -> None:
        """Lights to the camera frame; what was remembered is forgotten if the camera or a still body has moved."""
        vectors = light_vectors(self.scene.lights, frames)
        if self.scene.lights:
            store(self.lights.vector, vectors)
        if self._cached:
            still = np.flatnonzero(self._still)
            basis = (frames.rotation[:, still], frames.translation[:, still], vectors)
            if self._basis is None or not all(map(np.array_equal, basis, self._basis)):
                self._cached_triangle.fill_(-1)
                self._basis = basis

    def shade(self, radiance: wp.array) -> tuple[int, int]:
        """Write [E, H, W] radiance. Gives how many pixels were not finite, and how many were clipped to float16."""
        v = self.visibility
        self._not_finite.zero_()
        self._clipped.zero_()
        shared = [v.packed, v.vertices, v.rotation, v.translation, self.surfaces, self.lights, self.casters]
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
        texels, places, start = [np.zeros((0, 3), np.float32)], [], 0
        for material in scene.materials:
            _check_colour(scene, f"material '{material.name}' albedo", material.albedo)
            _check_colour(scene, f"material '{material.name}' emission", material.emission)
            if material.texture is None:
                places.append((0, 0, 0))
                continue
            texture = np.asarray(material.texture, np.float32)
            if texture.ndim != 3 or texture.shape[2] != 3 or not texture.size or not np.isfinite(texture).all():
                raise ValueError(
                    f"scene {scene.name}: texture of material '{material.name}' must be finite [h, w, 3], "
                    f"it is {list(texture.shape)}"
                )
            places.append((start, texture.shape[1], texture.shape[0]))
            texels.append(texture.reshape(-1, 3))
            start += texture.shape[0] * texture.shape[1]
        _check_colour(scene, "environment", scene.environment)
        none2, none3 = np.zeros((0, 2)), np.zeros((0, 3))
        surfaces.instance, surfaces.triangles = self.visibility.triangle_instance, self.visibility.triangles
        surfaces.normals = self.normals
        surfaces.uv = put(none2 if geometry.uv is None else geometry.uv, wp.vec2)
        surfaces.smooth = put(none3 if geometry.smooth is None else geometry.smooth, wp.vec3)
        surfaces.material = put(np.array([i.material for i in scene.instances], np.int32), wp.int32)
        surfaces.albedo = put(np.array([m.albedo for m in scene.materials]).reshape(-1, 3), wp.vec3)
        surfaces.emission = put(np.array([m.emission for m in scene.materials]).reshape(-1, 3), wp.vec3)
        # A mesh without texture coordinates has its material's plain albedo.
        shown = [places[i.material] if i.mesh.uv is not None else (0, 0, 0) for i in scene.instances]
        surfaces.texture = put(np.array(shown, np.int32).reshape(-1, 3), wp.vec3i)
        surfaces.texels = put(np.concatenate(texels), wp.vec3)
        surfaces.environment = wp.vec3(*(float(v) for v in scene.environment))
        return surfaces, geometry.uv is not None

    def _make_lights(self) -> Any:
        scene, put = self.scene, self.visibility.put
        for light in scene.lights:
            where = f"scene {scene.name}: light '{light.name}'"
            if light.kind not in KINDS:
                raise ValueError(f"{where} is of kind '{light.kind}'; kinds are {', '.join(KINDS)}")
            if not np.isfinite(light.vector).all() or (light.kind == "directional" and not np.any(light.vector)):
                raise ValueError(f"{where} has vector {np.asarray(light.vector).tolist()}; it must be finite and not 0")
            if not WORLD <= light.body < len(scene.bodies):
                raise ValueError(f"{where} is on body {light.body}; the scene has {len(scene.bodies)}")
            _check_colour(scene, f"light '{light.name}' colour", light.colour)
        lights = shading_kernels.Lights()
        lights.kind = put(np.array([KINDS[l.kind] for l in scene.lights], np.int32), wp.int32)
        lights.colour = put(np.array([l.colour for l in scene.lights]).reshape(-1, 3), wp.vec3)
        lights.shadow = put(np.array([l.shadows for l in scene.lights], np.int32), wp.int32)
        lights.vector = self.visibility.empty((self.visibility.envs, len(scene.lights)), wp.vec3)
        return lights

    def _make_casters(self, shadows: bool) -> Any:
        geometry, put = self.visibility.geometry, self.visibility.put
        ids = np.array([self._mesh(mesh) if shadows else 0 for mesh in geometry.meshes], np.uint64)
        order = np.argsort(~self._still, kind="stable")
        order = order[ids[order] != 0]
        casters = shading_kernels.Casters()
        casters.mesh, casters.order = put(ids, wp.uint64), put(order, wp.int32)
        casters.radius, casters.shell = put(geometry.radius, wp.float32), put(geometry.shell, wp.int32)
        casters.still = int(self._still[order].sum())
        casters.is_still = put(self._still.astype(np.int32), wp.int32)
        return casters

    def _mesh(self, mesh: Mesh) -> int:
        """Id of the ray-tracing structure of a mesh, built once for all its instances; 0 for an empty one."""
        if not len(mesh.faces):
            return 0
        if id(mesh) not in self._blas:
            points = np.asarray(mesh.vertices, np.float64)
            points = points - (points.min(0) + points.max(0)) / 2
            self._blas[id(mesh)] = wp.Mesh(
                points=self.visibility.put(points, wp.vec3),
                indices=self.visibility.put(np.asarray(mesh.faces).reshape(-1), wp.int32),
                bvh_constructor="sah",
            )
        return int(self._blas[id(mesh)].id)


def light_vectors(lights: list[Light], frames: Frames) -> np.ndarray:
    """float64 [E, L, 3] in the camera frame: unit vector towards a directional light, position of a point light."""
    vectors = np.zeros((len(frames.camera), len(lights), 3))
    for index, light in enumerate(lights):
        rotation, position = frames.body(light.body)
        vector = np.asarray(light.vector, np.float64)
        if light.kind == "directional":
            vectors[:, index] = -(rotation @ (vector / np.linalg.norm(vector)))
        else:
            vectors[:, index] = rotation @ vector + position
    return vectors


def _check_colour(scene: Scene, what: str, colour: Any) -> None:
    values = np.asarray(colour, np.float64)
    if values.shape != (3,) or not np.isfinite(values).all() or (values < 0).any():
        raise ValueError(f"scene {scene.name}: {what} is {values.tolist()}; it must be three numbers of at least 0")

