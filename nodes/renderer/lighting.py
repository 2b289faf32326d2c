"""Computes the light on what a `Visibility` sees: materials, lights and shadow casters of a scene on the device."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.gpu.host_copies import HostCopies
from nodes.renderer.geometry.poses import InstancePoses
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.lights.features import Features
from nodes.renderer.lights.lights import LightSet
from nodes.renderer.lights.sky import make_sky
from nodes.renderer.materials.ggx import is_plain
from nodes.renderer.raster.surface_kernels import VisibilityBuffer
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shading import shading_kernels
from nodes.renderer.shading.cache_kernels import ShadingCache
from nodes.renderer.shading.options import ShadingOptions
from nodes.renderer.shading.radiance_kernels import make_image
from nodes.renderer.shading.shadow_pass import ShadowPass, shadowed
from nodes.renderer.shading.surfaces import make_surfaces
from nodes.renderer.shadows.grid import ShadowGrid
from nodes.renderer.shadows.grid_kernels import Grid
from nodes.renderer.shadows.occlusion import Occluders

CACHED_LIGHTS = 32
"""Most lights, one bit each, under which still surfaces are remembered."""

if TYPE_CHECKING:
    from nodes.renderer.paths.paths import Paths

SHADE_BLOCK = 128
"""Threads of a block that shades: fewer than usual wait for the slowest of them."""

LIST_WORKERS = 1 << 19
"""Threads that share a list of pixels on a GPU."""

make_shade = cache(shading_kernels.make_shade)


class Shading:
    """Fills an image of radiance, of luminance, or both, from a visibility's z-buffer.

    Call `update` with the frames that the visibility was updated with, then `shade`. While the camera, all lights and
    the still bodies stay where they are, the light on still surfaces is remembered, and only what moving casters do to
    it is traced; the image is the same, bit for bit. Of flickering lights it is remembered only whom they reach.

    A material of roughness 1 without metal is plain diffuse, any other the GGX of glTF 2.0; emission, lights' `colour`
    and the sky are as in `evis.scene.model`. Area lights are unseen themselves, cast soft shadows by `light_samples`
    rays with random numbers that belong to the surface (none where nothing can be in the way), and need materials that
    glow in their place to be seen. Without `paths`, surfaces that emit light nothing else, and nothing hides the sky;
    with them, see `Paths`.
    """

    def __init__(
        self,
        visibility: Visibility,
        options: ShadingOptions,
        meshes: dict[int, wp.Mesh] | None = None,
    ) -> None:
        """Takes what sees the scene. meshes: see Occluders."""
        scene, geometry = visibility.scene, visibility.geometry
        self.visibility, self.scene, self.device = visibility, scene, visibility.device
        self._half, paths, on_gpu = options.half, options.paths, self.device.is_cuda
        self.pixel: Any = wp.vec3h if self._half else wp.vec3f
        self.scalar: Any = wp.float16 if self._half else wp.float32
        self.normals = visibility.put(geometry.normals, wp.vec3)
        self._still = geometry.static & is_static(scene, visibility.camera_body)
        self.surfaces, textured = make_surfaces(visibility, self.normals)
        self.lights = LightSet(visibility, options.light_samples)
        gloss = any(not is_plain(scene.materials[i.material]) for i in scene.instances)
        self.sky = make_sky(visibility, gloss)
        shadows = any(light.shadows for light in scene.lights) and len(geometry.triangles) > 0
        rays = paths is not None and len(geometry.triangles) > 0
        self._merged = rays and on_gpu if options.merged is None else options.merged
        active = shadows or rays or options.traced
        self.occluders = Occluders(visibility, geometry.static, active, merged=self._merged, meshes=meshes)
        cached = options.remember and self._cacheable()
        self._listed = not options.remember
        self._still_place = -1
        self._cache = self._make_cache(visibility.shape if cached else (0, 0, 0))
        # Pixels that were not finite, and that were clipped, of each thread that shares the rows.
        self._host_counts: HostCopies | None = None
        self._counts = wp.zeros((2, len(visibility.row_tiles.parts)), dtype=wp.int32, device=self.device)
        self._each_count = self._counts[0], self._counts[1]
        self._written: tuple[Any, ...] = ()
        """What was written to last, and the struct that kernels have of it."""
        self._no_grid = Grid()
        # In a GPU's way: rays in a pass of their own, and neighbouring threads on a tile of pixels.
        self._tiled = on_gpu if options.split is None else options.split
        self.shadow_pass: ShadowPass | None = None
        if self._tiled and not cached and shadowed(visibility):
            self.shadow_pass = ShadowPass(visibility, self.lights, self.occluders, self.normals)
        # A pass of their own has grids too.
        by_grid = [] if self._tiled or cached else shadowed(visibility)
        by_grid = [light for light in by_grid if ShadowGrid.suits(visibility, self.occluders, light)]
        self._grid = ShadowGrid(visibility, self.occluders, by_grid) if by_grid else None
        self.seen = self._make_seen()
        self.features = self._features_of(textured, gloss, shadows, rays, cached)
        self._kernel, self._list_kernel = make_shade(self.features)
        self.paths: Paths | None = None
        if rays and paths is not None:
            from nodes.renderer.paths.paths import Paths

            self.paths = Paths(visibility, paths, self.features, self._half)
            self._direct = self._image(False, self.paths.direct, None)

    def kernels(self, listed: bool) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that light a whole image, or a list of pixels, as `build_together` takes them."""
        direct = self._list_kernel if listed else self._kernel
        made = [direct] if self.paths is None else [direct, self.paths.kernel(listed)]
        rays = self.shadow_pass.kernels(listed) if self.shadow_pass is not None else []
        placing = [*self.occluders.kernels, *(self._grid.kernels if self._grid else [])]
        return [*((kernel, SHADE_BLOCK) for kernel in made), *rays, *self.lights.kernels, *placing]

    def _features_of(self, textured: bool, gloss: bool, shadows: bool, rays: bool, cached: bool) -> Features:
        """Finds what the scene needs of the kernels of light. rays: whether light comes by paths."""
        scene, geometry, kinds = self.scene, self.visibility.geometry, self.lights.kinds
        return Features(
            textures=textured,
            smooth=geometry.smooth is not None,
            vertex_colours=geometry.tint is not None,
            gloss=gloss,
            directional="directional" in kinds,
            point="point" in kinds,
            spot="spot" in kinds,
            area="area" in kinds,
            hard=shadows and any(light.shadows and light.kind != "area" for light in scene.lights),
            soft=shadows and any(light.shadows and light.kind == "area" for light in scene.lights),
            flicker=self.lights.flickers,
            sky_map=scene.environment_map is not None,
            ambient=not rays,
            trees=self.occluders.trees,
            merged=self._merged,
            cached=cached,
            shadow_pass=self.shadow_pass is not None,
            grids=self._grid is not None,
            tiled=self._tiled,
            by_runs=self.device.is_cpu,
            fast_math=self.device.is_cuda,
            half=self._half and not rays,
        )

    def _make_cache(self, shape: tuple[int, ...]) -> ShadingCache:
        """Makes an empty memory of still surfaces for an image [E, H, W]."""
        cache = ShadingCache()
        cache.triangle = wp.full(shape, -1, dtype=wp.int32, device=self.device)
        cache.lit_mask = wp.zeros(shape, dtype=wp.uint32, device=self.device)
        cache.radiance = wp.zeros(shape, dtype=wp.vec3, device=self.device)
        return cache

    def _make_seen(self) -> VisibilityBuffer:
        """Gathers what the kernels read of the visibility and of the shadow pass."""
        v, seen = self.visibility, VisibilityBuffer()
        seen.packed, seen.vertices = v.packed, v.vertices
        seen.rotation, seen.translation = v.rotation, v.translation
        if self.shadow_pass is not None:
            seen.shadow_mask = self.shadow_pass.shadow_mask
        return seen

    def update(self, frames: InstancePoses) -> None:
        """Brings lights to the camera frame; what was remembered is forgotten if the camera or a still body has
        moved."""
        self.occluders.update(frames)
        if self.features.cached and self._still_place != self.visibility.still_place:
            self._still_place = self.visibility.still_place
            self._cache.triangle.fill_(-1)

    def set_time(self, t_ns: int | np.ndarray) -> bool:
        """Sets flickering lights to what they are at an instant; True where one is not as it was."""
        return self.set_times(np.full(self.visibility.envs, t_ns, np.int64))

    def set_times(self, t_ns: np.ndarray) -> bool:
        """Sets flickering lights as `set_time` does, to an instant of each environment, int64 [E] ns."""
        return self.lights.set_times(t_ns)

    def place(self) -> None:
        """Prepares what shading needs of the poses alone: launches only, as in `placed` and `shade`."""
        self.occluders.launch()
        self.lights.launch()
        self._counts.zero_()
        if self.shadow_pass is not None and not self._listed:
            self.shadow_pass.clear()

    def placed(self) -> None:
        """Prepares what shading needs of the visibility's placed instances."""
        self.occluders.launch_moving()
        if self.shadow_pass is not None:
            self.shadow_pass.place()
        if self._grid is not None:
            self._grid.place()

    def shade(self, radiance: wp.array | None, ready: bool = False, luminance: wp.array | None = None) -> None:
        """Writes [E, H, W] radiance of `pixel`, luminance of `scalar`, or both: launches only, that a graph may hold.

        ready: after `place` and `placed`.
        """
        if not ready:
            self.place()
            self.placed()
        v = self.visibility
        envs, _, width = v.shape
        bands = {row0: k for k, (row0, _) in enumerate(v.row_tiles.parts)}

        def launch(kernel: wp.Kernel, shared: list[Any]) -> None:
            def arguments(row0: int, row1: int) -> tuple[tuple[int, ...], list[Any]]:
                # Paths go by rows.
                tiled = self._tiled and kernel is self._kernel
                dim = v.tiles if tiled else (envs, row1 - row0, width // v.span)
                return dim, [v.view, row0, bands[row0], v.span, *shared]

            v.row_tiles.launch(kernel, arguments, self.device, SHADE_BLOCK, in_parts=True)

        if self.shadow_pass is not None:
            self.shadow_pass.launch()
        self._run(launch, self._image(self._half, radiance, luminance), False)

    def shade_list(
        self,
        radiance: wp.array | None,
        pixels: wp.array,
        count: wp.array,
        firsts: list[int],
        ready: bool = False,
        luminance: wp.array | None = None,
    ) -> None:
        """Writes only the pixels of a list, int32 indices into [E, H, W]; radiance and luminance as in `shade`.

        Band b has count[b] of them from pixels[firsts[b]] on; count is read where the kernel runs. ready: nothing has
        moved since a list before.
        """
        if not ready:
            self.place()
            self.placed()
        v = self.visibility
        workers = 1 if self.device.is_cpu else LIST_WORKERS
        bands = {row0: k for k, (row0, _) in enumerate(v.row_tiles.parts)}

        def launch(kernel: wp.Kernel, shared: list[Any]) -> None:
            def arguments(row0: int, row1: int) -> tuple[int, list[Any]]:
                k = bands[row0]
                return workers, [v.view, workers, firsts[k], k, pixels, count, *shared]

            v.row_tiles.launch(kernel, arguments, self.device, SHADE_BLOCK, in_parts=True)

        if self.shadow_pass is not None:
            self.shadow_pass.launch_list(workers, pixels, count)
        self._run(launch, self._image(self._half, radiance, luminance), True)

    def _image(self, half: bool, radiance: wp.array | None, luminance: wp.array | None) -> Any:
        """Makes the struct of what kernels write light to."""
        if self._written and all(a is b for a, b in zip(self._written, (half, radiance, luminance))):
            return self._written[3]
        image = make_image(half)()
        if radiance is not None:
            image.radiance = radiance
        if luminance is not None:
            image.luminance = luminance
        image.not_finite, image.clipped = self._each_count
        self._written = half, radiance, luminance, image
        return image

    def _run(self, launch: Callable[[wp.Kernel, list[Any]], None], image: Any, listed: bool) -> None:
        """Launches what shades a whole image, or a list of its pixels."""
        light = [self.seen, self.surfaces, self.lights.kernel, self.sky, self.occluders.casters]
        kernel = self._list_kernel if listed else self._kernel
        grid = self._no_grid if self._grid is None else self._grid.kernel
        launch(kernel, [*light, grid, self._cache, image if self.paths is None else self._direct])
        if self.paths is not None:
            launch(self.paths.kernel(listed), self.paths.arguments(light, image))

    def counts(self) -> tuple[int, int]:
        """Finds how many pixels of the last image were not finite, and how many were clipped to float16; waits for
        it."""
        not_finite, clipped = self._counts.numpy().sum(1)
        return int(not_finite), int(clipped)

    def counts_later(self) -> Callable[[], tuple[int, int]]:
        """Makes a function that gives `counts` of the images launched by now, and waits for these alone."""
        if self._host_counts is None:
            self._host_counts = HostCopies(self._counts)
        read = self._host_counts.take()

        def found() -> tuple[int, int]:
            not_finite, clipped = read().sum(1)
            return int(not_finite), int(clipped)

        return found

    def _cacheable(self) -> bool:
        """Tells whether some light on some surface can stay the same while something moves."""
        lights = self.scene.lights
        still = all(is_static(self.scene, light.body) for light in lights) and len(lights) <= CACHED_LIGHTS
        return still and bool(self._still.any())
