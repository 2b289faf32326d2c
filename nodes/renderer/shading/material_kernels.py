"""Computes how a seen surface takes light: its material by glTF's metallic-roughness model, and what it emits."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.features import Features
from nodes.renderer.lights.sky_kernels import Sky, make_sky, reflectances
from nodes.renderer.lights.surface_point_kernels import SurfacePoint
from nodes.renderer.materials.ggx_kernels import diffuse_share, normal_reflectance
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import Pixel, SurfaceHit, Surfaces, VisibilityBuffer, make_surface

wp.set_module_options({"enable_backward": False})


@cache
def make_reflection(f: Features) -> Any:
    """Makes the function `reflection_of`."""
    _, ambient, specular_sky_light = make_sky(f.sky_map, f.by_runs)

    @wp.func(inline=True)
    def reflection_of(
        env: int,
        surfaces: Surfaces,
        sky: Sky,
        hit: SurfaceHit,
        point: SurfacePoint,
        colour: wp.vec3,
        shading_normal: wp.vec3,
    ):
        """Gives the point with what it reflects by its lobe, the albedo of its diffuse term, and the radiance that it
        has without lights: what it emits, and reflects of the sky. colour: the albedo of all of its terms."""
        s = point
        albedo = colour
        s.shading_normal = shading_normal
        s.alpha = -1.0
        m = surfaces.material[hit.instance]
        unlit = wp.vec3(0.0, 0.0, 0.0)
        if wp.static(f.ambient):
            unlit = wp.cw_mul(albedo, ambient(sky, env, shading_normal))
        if wp.static(f.gloss):
            s.alpha = surfaces.gloss[m][0]
            if s.alpha >= 0.0:
                metallic = surfaces.gloss[m][1]
                s.view = -wp.normalize(hit.ray)
                s.f0 = normal_reflectance(albedo, metallic)
                if wp.static(f.ambient):
                    specular_sky, r = specular_sky_light(sky, env, shading_normal, s.view, s.alpha, s.f0)
                    unlit = specular_sky + diffuse_share(r, metallic) * unlit
                else:
                    r = reflectances(sky, s.alpha, wp.dot(shading_normal, s.view))
                albedo = diffuse_share(r, metallic) * albedo
        return s, albedo, surfaces.emission[m] + unlit

    return reflection_of


@cache
def make_material(f: Features) -> Any:
    """Makes the function `material_at`."""
    surface, reflection_of = make_surface(f.textures, f.smooth, f.vertex_colours), make_reflection(f)

    @wp.func(inline=True)
    def material_at(
        view: CameraView,
        pixel: Pixel,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        sky: Sky,
        hit: SurfaceHit,
        point: SurfacePoint,
    ):
        """Gives what `reflection_of` gives where a pixel sees a triangle."""
        albedo, shading_normal = surface(view, pixel, seen, surfaces, hit)
        return reflection_of(pixel.env, surfaces, sky, hit, point, albedo, shading_normal)

    return material_at
