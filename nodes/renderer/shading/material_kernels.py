"""How a seen surface takes light: its material by glTF's metallic-roughness model, and what it shines with anyway."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.features import Features
from nodes.renderer.lights.light_kernels import SurfacePoint
from nodes.renderer.lights.sky_kernels import DIELECTRIC, Sky, make_sky, reflectances
from nodes.renderer.raster.surface_kernels import Face, Pixel, Seen, Surfaces, make_surface
from nodes.renderer.raster.triangle_kernels import View

wp.set_module_options({"enable_backward": False})


@wp.func
def normal_reflectance(albedo: wp.vec3, metallic: float):
    """F0 of glTF 2.0."""
    return DIELECTRIC * (1.0 - metallic) * wp.vec3(1.0, 1.0, 1.0) + metallic * albedo


@cache
def make_look(f: Features) -> Any:
    """The function `look`."""
    surface = make_surface(f.textures, f.smooth, f.tinted)
    _, ambient, sky_gloss = make_sky(f.mapped)

    @wp.func
    def look(view: View, pixel: Pixel, seen: Seen, surfaces: Surfaces, sky: Sky, face: Face, point: SurfacePoint):
        """The point with what it reflects by its lobe, the albedo of its diffuse term, and the radiance that it has
        without lights: what it emits, and reflects of the sky."""
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
                left = wp.float32(0.0)
                if wp.static(f.ambience):
                    mirrored, left = sky_gloss(sky, pixel.env, facing, s.view, s.alpha, s.f0)
                    left *= 1.0 - metallic
                    glow = mirrored + left * glow
                else:
                    r = reflectances(sky, s.alpha, wp.dot(facing, s.view))
                    left = (1.0 - DIELECTRIC * r[0] - r[1]) * (1.0 - metallic)
                albedo = left * albedo
        return s, albedo, surfaces.emission[m] + glow

    return look
