"""Computes the radiance of the pixels that a z-buffer has found: what surfaces emit, and reflect of the lights and the
sky.

The way of a pixel: the triangle that it sees (surface_kernels), what is remembered of it (cache_kernels), else its
material and the sky's light on it (material_kernels), the light of lights (lights/direct_kernels and area_kernels) as
far as nothing is in the way (shadows/ray_kernels), and out (radiance_kernels).
"""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.area_sample_kernels import frozen_key
from nodes.renderer.lights.direct_kernels import make_direct_light
from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import DirectLight, Lights
from nodes.renderer.lights.sky_kernels import Sky, make_sky
from nodes.renderer.lights.surface_point_kernels import SurfacePoint, with_ray_origin
from nodes.renderer.materials.ggx_kernels import INVERSE_PI
from nodes.renderer.raster.depth_kernels import MISS
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray, tile_pixel
from nodes.renderer.raster.surface_kernels import (
    Pixel,
    SurfaceHit,
    Surfaces,
    VisibilityBuffer,
    listed_pixel,
    pixel_at,
    primary_hit,
    seen_triangle,
)
from nodes.renderer.shading.cache_kernels import ShadingCache, make_cache
from nodes.renderer.shading.material_kernels import make_material
from nodes.renderer.shading.radiance_kernels import make_image, make_write
from nodes.renderer.shadows.grid_kernels import Grid
from nodes.renderer.shadows.ray_kernels import Casters

wp.set_module_options({"enable_backward": False})


@cache
def make_surface_light(f: Features) -> tuple[Any, Any]:
    """Makes the functions `point_of` and `surface_radiance`."""

    @wp.func
    def point_of(casters: Casters, hit: SurfaceHit):
        """Gives the seen point, with where its shadow rays start."""
        s = SurfacePoint()
        s.position = hit.position
        s.normal = hit.normal
        if wp.static(f.shadows):
            s = with_ray_origin(casters, s, hit)
        return s

    @wp.func
    def surface_radiance(unlit: wp.vec3, albedo: wp.vec3, irradiance: wp.vec3, specular: wp.vec3):
        """Gives the radiance of a surface under light."""
        colour = unlit + INVERSE_PI * wp.cw_mul(albedo, irradiance)
        if wp.static(f.gloss):
            colour += specular
        return colour

    return point_of, surface_radiance


@cache
def make_shade_pixel(f: Features) -> Any:
    """Makes the function `shade_pixel` with only what a scene has."""
    Image: Any = make_image(f.half)
    write = make_write(f.half)
    material_at, direct_light = make_material(f), make_direct_light(f)
    point_of, surface_radiance = make_surface_light(f)
    recall, remember = make_cache(f)
    background, _, _ = make_sky(f.sky_map)

    # Its arguments are large structs, which a call on a CPU would copy for every pixel.
    @wp.func(inline=True)
    def shade_pixel(
        view: CameraView,
        pixel: Pixel,
        band: int,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        grid: Grid,
        shading_cache: ShadingCache,
        image: Image,
    ):
        """Computes and writes the radiance of one pixel."""
        colour = wp.vec3(0.0, 0.0, 0.0)
        if seen_triangle(seen, pixel) == MISS:
            colour = background(sky, pixel.env, pixel_ray(view, pixel.x, pixel.y))
        else:
            hit = primary_hit(view, seen, surfaces, pixel)
            start = point_of(casters, hit)
            cached, lit_mask, valid = recall(lights, casters, shading_cache, pixel, hit.triangle, start)
            if valid:
                colour = shading_cache.radiance[pixel.env, pixel.y, pixel.x]
            else:
                s, albedo, unlit = material_at(view, pixel, seen, surfaces, sky, hit, start)
                if wp.static(f.area):
                    q = wp.transpose(hit.rotation) * (s.position - seen.translation[pixel.env, hit.instance])
                    s.key = frozen_key(q, wp.length(s.position) / view.fx, hit.instance)
                shadow_mask = wp.uint32(0)
                if wp.static(f.shadow_pass):
                    shadow_mask = seen.shadow_mask[pixel.env, pixel.y, pixel.x]
                light = DirectLight()
                if wp.static(f.lit):
                    light = direct_light(lights, casters, grid, pixel.env, s, cached, lit_mask, shadow_mask)
                colour = surface_radiance(unlit, albedo, light.irradiance, light.specular)
                if wp.static(f.cached):
                    if not cached:
                        without_movers = surface_radiance(unlit, albedo, light.still_irradiance, light.still_specular)
                        remember(casters, shading_cache, pixel, hit, light.lit_mask, without_movers)
        write(pixel.env, pixel.y, pixel.x, band, colour, image)

    return shade_pixel


def make_shade(f: Features) -> tuple[wp.Kernel, wp.Kernel]:
    """Makes the shading kernels, of all pixels and of a list of them."""
    Image: Any = make_image(f.half)
    shade_pixel = make_shade_pixel(f)
    options = {"fast_math": f.fast_math}

    # Kernels name their parameters one by one; these two share what they do, and so most of their names.
    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def shade(
        # in
        view: CameraView,
        row0: int,
        band: int,
        span: int,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        grid: Grid,
        # in and out
        shading_cache: ShadingCache,
        # out
        image: Image,
    ):
        """Shades all pixels of rows from row0 on, or of tiles.

        Args:
            row0: first row.
            band: place in the counts of `image`.
            span: pixels of a row that a thread does.
            seen: the z-buffer that is shaded.
            shading_cache: what is remembered of still surfaces.
            image: what light is written to.
        """
        env, row, part = wp.tid()
        if wp.static(f.tiled):
            y, x = tile_pixel(view, row, part)
            if y < view.height and x < view.width:
                shade_pixel(
                    view, pixel_at(env, y, x), band, seen, surfaces, lights, sky, casters, grid, shading_cache, image
                )
        else:
            y = row0 + row
            for x in range(part * span, wp.min(part * span + span, view.width)):
                shade_pixel(
                    view, pixel_at(env, y, x), band, seen, surfaces, lights, sky, casters, grid, shading_cache, image
                )

    @wp.kernel(module="unique", enable_backward=False, module_options=options)
    def shade_list(
        # in
        view: CameraView,
        workers: int,
        first: int,
        band: int,
        pixels: wp.array(dtype=int),
        count: wp.array(dtype=int),
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        grid: Grid,
        # in and out
        shading_cache: ShadingCache,
        # out
        image: Image,
    ):
        """Shades listed pixels.

        Args:
            workers: threads that share the list.
            first: of the list.
            band: place in `count` and in the counts of `image`.
            pixels: indices into [E, H, W].
            count: [bands] how many there are.
            seen, shading_cache, image: as of `shade`.
        """
        j = wp.tid()
        while j < count[band]:
            pixel = listed_pixel(view, pixels[first + j])
            shade_pixel(view, pixel, band, seen, surfaces, lights, sky, casters, grid, shading_cache, image)
            if wp.static(f.shadow_pass):
                # For the next list.
                seen.shadow_mask[pixel.env, pixel.y, pixel.x] = wp.uint32(0)
            j += workers

    return shade, shade_list
