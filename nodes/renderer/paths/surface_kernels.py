"""Computes the surface points of paths: what they reflect, and into which direction a path goes on."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.light_kernels import SurfacePoint
from nodes.renderer.lights.sky_kernels import Sky, reflectances
from nodes.renderer.materials.ggx_kernels import (
    PI,
    diffuse_share,
    normal_reflectance,
    sample_density,
    sample_direction,
    specular,
    specular_share,
)
from nodes.renderer.paths.sampling_kernels import cosine_direction
from nodes.renderer.raster.surface_kernels import Surfaces, tint_of
from nodes.renderer.shading.radiance_kernels import luminance
from nodes.renderer.shadows.ray_kernels import Casters, shadow_start
from nodes.renderer.textures.texture_kernels import bilinear

wp.set_module_options({"enable_backward": False})

LEAST_LOBE = wp.constant(0.1)
"""Least share of the directions that each of two lobes gets."""


@wp.struct
class Bodies:
    """Holds what a ray that hits an instance has to know. first, two_sided, body frame; points: vertices of the
    instances."""

    first: wp.array(dtype=int)
    two_sided: wp.array(dtype=int)
    points: wp.array(dtype=wp.vec3)


@wp.struct
class PathVertex:
    """Holds where a path is, and how it goes on. diffuse: albedo of the diffuse term; share of the specular lobe in the
    directions that are taken; turn: the instance's rotation to the camera frame."""

    point: SurfacePoint
    diffuse: wp.vec3
    share: float
    turn: wp.mat33


@wp.func
def spread_of(pdf: float, samples: int):
    """Gives the width of a cone that holds one sample's share of directions, per metre."""
    return wp.min(wp.sqrt(4.0 / (PI * pdf * float(samples))), 1.0)


@wp.func
def lifted(casters: Casters, s: SurfacePoint, i: int, side: float):
    """Gives the point with what its rays leave out and where they start."""
    r = s
    lift, alone = shadow_start(casters, i, s.position, s.normal, side > 0.0)
    r.lift = lift
    r.alone = alone
    return r


@cache
def make_reflection(gloss: bool) -> tuple[Any, Any, Any]:
    """Makes the functions `vertex_of`, `reflected` and `onward`."""

    @wp.func
    def vertex_of(point: SurfacePoint, turn: wp.mat33, sky: Sky, albedo: wp.vec3, gloss_of: wp.vec2, least: float):
        """Makes a path's vertex on a material of this albedo and gloss (alpha, metallic), alpha widened to `least`."""
        v = PathVertex()
        s = point
        alpha = gloss_of[0]
        diffuse = albedo
        share = wp.float32(0.0)
        f0 = wp.vec3(0.0, 0.0, 0.0)
        if wp.static(gloss):
            if alpha >= 0.0:
                metallic = gloss_of[1]
                alpha = wp.max(alpha, least)
                f0 = normal_reflectance(albedo, metallic)
                r = reflectances(sky, alpha, wp.dot(s.facing, s.view))
                diffuse = diffuse_share(r, metallic) * albedo
                shine = luminance(specular_share(r, f0))
                matt = luminance(diffuse)
                share = 1.0
                if matt > 0.0:
                    share = wp.clamp(shine / (shine + matt), LEAST_LOBE, 1.0 - LEAST_LOBE)
        s.alpha = alpha
        s.f0 = f0
        v.diffuse = diffuse
        v.share = share
        v.turn = turn
        v.point = s
        return v

    @wp.func
    def reflected(v: PathVertex, l: wp.vec3):
        """Gives BRDF times cosine for direction l, and the density with which a path takes it; 0 below the surface."""
        cosine = wp.dot(v.point.facing, l)
        if cosine <= 0.0 or wp.dot(v.point.normal, l) <= 0.0:
            return wp.vec3(0.0, 0.0, 0.0), 0.0
        value = v.diffuse * (cosine / PI)
        density = cosine / PI
        if wp.static(gloss):
            if v.point.alpha >= 0.0:
                value += cosine * specular(v.point.alpha, v.point.f0, v.point.facing, v.point.view, l)
                density = (1.0 - v.share) * density + v.share * sample_density(
                    v.point.alpha, v.point.facing, v.point.view, l
                )
        return value, density

    @wp.func
    def onward(v: PathVertex, u: wp.vec2):
        """Gives the direction that a path takes from its vertex for u in [0, 1)^2."""
        # One number chooses the lobe and, from what is left of it, the direction.
        if u[0] < v.share:
            return sample_direction(v.point.alpha, v.point.facing, v.point.view, wp.vec2(u[0] / v.share, u[1]))
        return cosine_direction(v.point.facing, v.turn, wp.vec2((u[0] - v.share) / (1.0 - v.share), u[1]))

    return vertex_of, reflected, onward


@wp.func
def wide_texture(surfaces: Surfaces, bodies: Bodies, i: int, t: int, w0: float, w1: float, width: float):
    """Gives the texture of instance i at a point of triangle t, averaged over `width` [m]."""
    place = surfaces.textures.place[i]
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
    return fine + (lod - float(base)) * (coarse - fine)


@cache
def make_albedo(textures: bool, tinted: bool) -> Any:
    """Makes the function of the albedo where a path meets a surface."""

    @wp.func
    def albedo_at(surfaces: Surfaces, bodies: Bodies, i: int, t: int, w0: float, w1: float, width: float):
        """Gives the albedo where a path meets a triangle, its texture averaged over the path's `width` [m]."""
        albedo = surfaces.albedo[surfaces.material[i]]
        if wp.static(textures):
            if surfaces.textures.place[i][1] > 0:
                albedo = wp.cw_mul(albedo, wide_texture(surfaces, bodies, i, t, w0, w1, width))
        if wp.static(tinted):
            albedo = wp.cw_mul(albedo, tint_of(surfaces, t, wp.vec3(w0, w1, 1.0 - w0 - w1)))
        return albedo

    return albedo_at
