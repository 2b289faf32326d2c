"""Computes how a seen surface takes light: its material by glTF's metallic-roughness model, and what it emits."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import SurfacePoint
from nodes.renderer.lights.sky_kernels import Sky, make_sky, reflectances
from nodes.renderer.materials.ggx_kernels import diffuse_share, normal_reflectance
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import Face, Pixel, Seen, Surfaces, make_surface

wp.set_module_options({"enable_backward": False})


@cache
def make_look(f: Features) -> Any:
    """Makes the function `look`."""
    surface = make_surface(f.textures, f.smooth, f.tinted)
    _, ambient, sky_gloss = make_sky(f.mapped, f.by_runs)

    @wp.func(inline=True)
    def look(view: CameraView, pixel: Pixel, seen: Seen, surfaces: Surfaces, sky: Sky, face: Face, point: SurfacePoint):
        """Gives the point with what it reflects by its lobe, the albedo of its diffuse term, and the radiance that it
        has without lights: what it emits, and reflects of the sky."""
        s = point
        albedo, facing = surface(view, pixel, seen, surfaces, face)
        s.facing = facing
        s.alpha = -1.0
        m = surfaces.material[face.instance]
        glow = wp.vec3(0.0, 0.0, 0.0)
        if wp.static(f.ambience):
            glow = wp.cw_mul(albedo, ambient(sky, pixel.env, facing))
        if wp.static(f.gloss):
            s.alpha = surfaces.gloss[m][0]
            if s.alpha >= 0.0:
                metallic = surfaces.gloss[m][1]
                s.view = -wp.normalize(face.ray)
                s.f0 = normal_reflectance(albedo, metallic)
                if wp.static(f.ambience):
                    mirrored, r = sky_gloss(sky, pixel.env, facing, s.view, s.alpha, s.f0)
                    glow = mirrored + diffuse_share(r, metallic) * glow
                else:
                    r = reflectances(sky, s.alpha, wp.dot(facing, s.view))
                albedo = diffuse_share(r, metallic) * albedo
        return s, albedo, surfaces.emission[m] + glow

    return look
