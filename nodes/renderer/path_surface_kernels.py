"""Surface points of paths: what they reflect, and into which direction a path goes on."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.ggx_kernels import sample_density, specular
from nodes.renderer.lights_kernels import SurfacePoint
from nodes.renderer.lights_shadow_kernels import Casters, shadow_start
from nodes.renderer.lights_sky_kernels import DIELECTRIC, Sky, reflectances
from nodes.renderer.path_sampling_kernels import PI
from nodes.renderer.shading_kernels import Surfaces
from nodes.renderer.texture_kernels import bilinear
from nodes.renderer.write_kernels import luminance

wp.set_module_options({"enable_backward": False})

LEAST_LOBE = wp.constant(0.1)
"""Least share of the directions that each of two lobes gets."""


@wp.struct
class Bodies:
    """What a ray that hits an instance has to know. first, two_sided, body frame; points: vertices of the instances."""

    first: wp.array(dtype=int)
    two_sided: wp.array(dtype=int)
    points: wp.array(dtype=wp.vec3)


@wp.func
def spread_of(pdf: float, samples: int):
    """Width of a cone that holds one sample's share of directions, per metre."""
    return wp.min(wp.sqrt(4.0 / (PI * pdf * float(samples))), 1.0)


@wp.func
def lifted(casters: Casters, s: SurfacePoint, i: int, side: float):
    """The point with what its rays leave out and where they start."""
    r = s
    lift, alone = shadow_start(casters, i, s.position, s.normal, side > 0.0)
    r.lift = lift
    r.alone = alone
    return r


@cache
def make_reflection(gloss: bool) -> tuple[Any, Any]:
    """The functions `lay` and `reflected`."""

    @wp.func
    def lay(s: SurfacePoint, sky: Sky, albedo: wp.vec3, metallic: float, least: float):
        """The diffuse albedo of a point with its gloss below `least` widened, and the share of its specular lobe."""
        share = wp.float32(0.0)
        diffuse = albedo
        f0 = wp.vec3(0.0, 0.0, 0.0)
        alpha = s.alpha
        if wp.static(gloss):
            if alpha >= 0.0:
                alpha = wp.max(alpha, least)
                one = wp.vec3(1.0, 1.0, 1.0)
                f0 = DIELECTRIC * (1.0 - metallic) * one + metallic * albedo
                r = reflectances(sky, alpha, wp.dot(s.facing, s.view))
                diffuse = ((1.0 - metallic) * (1.0 - DIELECTRIC * r[0] - r[1])) * albedo
                shine = luminance(r[0] * f0 + r[1] * one)
                matt = luminance(diffuse)
                share = 1.0
                if matt > 0.0:
                    share = wp.clamp(shine / (shine + matt), LEAST_LOBE, 1.0 - LEAST_LOBE)
        return diffuse, f0, alpha, share

    @wp.func
    def reflected(s: SurfacePoint, diffuse: wp.vec3, share: float, l: wp.vec3):
        """BRDF times cosine for direction l, and the density with which a path takes it; 0 below the surface."""
        cosine = wp.dot(s.facing, l)
        if cosine <= 0.0 or wp.dot(s.normal, l) <= 0.0:
            return wp.vec3(0.0, 0.0, 0.0), 0.0
        value = diffuse * (cosine / PI)
        density = cosine / PI
        if wp.static(gloss):
            if s.alpha >= 0.0:
                value += cosine * specular(s.alpha, s.f0, s.facing, s.view, l)
                density = (1.0 - share) * density + share * sample_density(s.alpha, s.facing, s.view, l)
        return value, density

    return lay, reflected


@cache
def make_albedo(textures: bool) -> Any:
    """The function of the albedo where a path meets a surface."""

    @wp.func
    def albedo_at(surfaces: Surfaces, bodies: Bodies, i: int, t: int, w0: float, w1: float, width: float):
        """Albedo where a path meets a triangle, its texture averaged over the path's `width` [m]."""
        albedo = surfaces.albedo[surfaces.material[i]]
        if wp.static(textures):
            place = surfaces.textures.place[i]
            if place[1] > 0:
                j = 3 * t
                uv0 = surfaces.uv[j]
                uv1 = surfaces.uv[j + 1]
                uv2 = surfaces.uv[j + 2]
                k = surfaces.triangles[t]
                a = bodies.points[k[0]]
                area = wp.length(wp.cross(bodies.points[k[1]] - a, bodies.points[k[2]] - a))
                e = uv1 - uv0
                f = uv2 - uv0
                level = surfaces.textures.levels[place[0]]
                texels = wp.abs(e[0] * f[1] - e[1] * f[0]) * float(level[1]) * float(level[2])
                lod = wp.log2(wp.max(width * wp.sqrt(texels / wp.max(area, 1.0e-30)), 1.0))
                lod = wp.min(lod, float(place[1] - 1))
                base = int(lod)
                uv = w0 * uv0 + w1 * uv1 + (1.0 - w0 - w1) * uv2
                fine = bilinear(surfaces.textures.texels, surfaces.textures.levels[place[0] + base], uv)
                above = surfaces.textures.levels[place[0] + wp.min(base + 1, place[1] - 1)]
                coarse = bilinear(surfaces.textures.texels, above, uv)
                albedo = wp.cw_mul(albedo, fine + (lod - float(base)) * (coarse - fine))
        return albedo

    return albedo_at
