"""Computes the radiance of single points of triangles, be they seen by a pixel or not."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.area_sample_kernels import frozen_key
from nodes.renderer.lights.direct_kernels import make_direct_light
from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import DirectLight, Lights
from nodes.renderer.lights.sky_kernels import Sky
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import (
    Pixel,
    SurfaceHit,
    Surfaces,
    VisibilityBuffer,
    barycentric_of,
    make_surface_at,
)
from nodes.renderer.raster.triangle_kernels import corners_of
from nodes.renderer.shading.material_kernels import make_reflection
from nodes.renderer.shading.shading_kernels import make_surface_light
from nodes.renderer.shadows.grid_kernels import Grid
from nodes.renderer.shadows.ray_kernels import Casters

wp.set_module_options({"enable_backward": False})

LEAST_TOTAL = wp.constant(1.0e-30)
"""Least sum of barycentric coordinates by which steps of a ray are divided: of a triangle seen edge on it is 0."""


@cache
def make_shade_point(f: Features) -> Any:
    """Makes the function `shade_point` with only what a scene has, of which nothing is remembered or known before."""
    surface_at = make_surface_at(f.textures, f.smooth, f.vertex_colours)
    reflection_of, direct_light = make_reflection(f), make_direct_light(f)
    point_of, surface_radiance = make_surface_light(f)

    @wp.func(inline=True)
    def shade_point(
        view: CameraView,
        pixel: Pixel,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        grid: Grid,
        triangle: int,
        side: float,
        weights: wp.vec3,
    ):
        """Gives the radiance of a point of a triangle, towards the camera of an environment.

        pixel: of the environment, as wide and high as which textures are filtered. side: -1 for the triangle's back,
        otherwise 1, wherever that faces. weights: of the triangle's corners, whose sum is 1.
        """
        hit = SurfaceHit()
        hit.triangle = triangle
        hit.instance = surfaces.instance[triangle]
        hit.rotation = seen.rotation[pixel.env, hit.instance]
        hit.side = side
        hit.normal = side * (hit.rotation * surfaces.normals[triangle])
        centre = seen.translation[pixel.env, hit.instance]
        a, b, c = corners_of(view, seen.vertices, surfaces.triangles, hit.rotation, centre, pixel.env, triangle)
        hit.position = weights[0] * a + weights[1] * b + weights[2] * c
        hit.ray = hit.position / wp.where(view.distorted == 1, wp.length(hit.position), hit.position[2])
        start = point_of(casters, hit)
        r = barycentric_of(view, seen, surfaces, pixel.env, hit)
        r.w = weights
        r.total = wp.where(wp.abs(r.total) < LEAST_TOTAL, LEAST_TOTAL, r.total)
        colour, shading_normal = surface_at(view, pixel, surfaces, hit, r)
        s, albedo, unlit = reflection_of(pixel.env, surfaces, sky, hit, start, colour, shading_normal)
        if wp.static(f.area):
            q = wp.transpose(hit.rotation) * (s.position - centre)
            s.key = frozen_key(q, wp.length(s.position) / view.fx, hit.instance)
        light = DirectLight()
        if wp.static(f.lit):
            light = direct_light(lights, casters, grid, pixel.env, s, False, wp.uint32(0), wp.uint32(0))
        return surface_radiance(unlit, albedo, light.irradiance, light.specular)

    return shade_point
