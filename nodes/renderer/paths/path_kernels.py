"""Computes light that reaches seen surfaces over other surfaces, from the sky and from glowing surfaces, by paths from
the camera.

At every surface point a path takes one direction from the mixture of its lobes and, by next-event estimation, aims once
at a glowing triangle and once at the sky's map; what two of these can find is weighted by the balance heuristic (Veach
and Guibas, SIGGRAPH 1995). From the second point on it aims at one light too, chosen by what each would give if it were
seen; at the first one the light of lights is there already.
"""

from typing import Any

import warp as wp

from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import Lights
from nodes.renderer.lights.sky_kernels import Sky
from nodes.renderer.paths.path_tracer_kernels import PathLimits, make_path_tracer
from nodes.renderer.paths.sampling_kernels import PathSources, frozen_shift
from nodes.renderer.paths.vertex_kernels import PathMeshes, make_vertices
from nodes.renderer.raster.depth_kernels import MISS
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import (
    Pixel,
    Surfaces,
    VisibilityBuffer,
    listed_pixel,
    pixel_at,
    primary_hit,
    seen_triangle,
)
from nodes.renderer.shading.radiance_kernels import make_image, make_write
from nodes.renderer.shadows.ray_kernels import Casters

wp.set_module_options({"enable_backward": False})


def make_paths(f: Features, emitters: bool, only_lights: bool, half: bool) -> tuple[wp.Kernel, wp.Kernel]:
    """Makes the kernels that add the light of paths to all pixels of an image, and to those of a list.

    f: of the shading kernel that brings the light of lights. emitters: some surface is one. only_lights: none is, and
    the sky is black. half: light is written as float16.
    """
    Image: Any = make_image(half)
    write = make_write(half)
    first_vertex, _ = make_vertices(f)
    path_radiance = make_path_tracer(f, emitters, only_lights)

    @wp.func
    def paths(
        view: CameraView,
        pixel: Pixel,
        limits: PathLimits,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        meshes: PathMeshes,
        sources: PathSources,
    ):
        """Gives the radiance of a pixel from paths."""
        if seen_triangle(seen, pixel) == MISS:
            return wp.vec3(0.0, 0.0, 0.0)
        hit = primary_hit(view, seen, surfaces, pixel)
        first = first_vertex(view, pixel, seen, surfaces, sky, casters, hit)
        i = hit.instance
        q = wp.transpose(hit.rotation) * (hit.position - seen.translation[pixel.env, i])
        shift = frozen_shift(q, casters.radius[i], i)
        return path_radiance(limits, i, shift, pixel.env, first, surfaces, lights, sky, casters, meshes, sources)

    # Kernels name their parameters one by one; these two share what they do, and so most of their names.
    @wp.kernel(module="unique", enable_backward=False)
    def add_paths(
        # in
        view: CameraView,
        row0: int,
        band: int,
        span: int,
        limits: PathLimits,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        meshes: PathMeshes,
        sources: PathSources,
        direct: wp.array3d(dtype=wp.vec3),
        # out
        image: Image,
    ):
        """Adds to every pixel the light that comes by paths, and writes it.

        Args:
            row0, band, span, image: as of shading_kernels' `shade`.
            meshes: what a path has to know of what it meets.
            sources: emitters and the sky, for next-event estimation.
            direct: [E, H, W] radiance without paths.
        """
        env, row, part = wp.tid()
        y = row0 + row
        for x in range(part * span, wp.min(part * span + span, view.width)):
            pixel = pixel_at(env, y, x)
            add = paths(view, pixel, limits, seen, surfaces, lights, sky, casters, meshes, sources)
            write(pixel.env, pixel.y, pixel.x, band, direct[pixel.env, pixel.y, pixel.x] + add, image)

    @wp.kernel(module="unique", enable_backward=False)
    def add_paths_list(
        # in
        view: CameraView,
        workers: int,
        first: int,
        band: int,
        pixels: wp.array(dtype=int),
        count: wp.array(dtype=int),
        limits: PathLimits,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        meshes: PathMeshes,
        sources: PathSources,
        direct: wp.array3d(dtype=wp.vec3),
        # out
        image: Image,
    ):
        """Adds the light that comes by paths to listed pixels, and writes them.

        Args:
            workers, first, band, pixels, count, image: as of shading_kernels' `shade_list`.
            meshes, sources, direct: as of `add_paths`.
        """
        j = wp.tid()
        while j < count[band]:
            pixel = listed_pixel(view, pixels[first + j])
            add = paths(view, pixel, limits, seen, surfaces, lights, sky, casters, meshes, sources)
            write(pixel.env, pixel.y, pixel.x, band, direct[pixel.env, pixel.y, pixel.x] + add, image)
            j += workers

    return add_paths, add_paths_list
