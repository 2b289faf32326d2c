"""Computes what a vertex of a path reflects, by its BRDF, and the direction that a path goes on in."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.sky_kernels import Sky, reflectances
from nodes.renderer.lights.surface_point_kernels import SurfacePoint
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
from nodes.renderer.shading.radiance_kernels import luminance

wp.set_module_options({"enable_backward": False})

LEAST_LOBE = wp.constant(0.1)
"""Least share of the directions that each of two lobes gets."""


@wp.struct
class PathVertex:
    """Holds where a path is, and how it goes on. diffuse: albedo of the diffuse term; share of the specular lobe in the
    directions that are taken; rotation: the instance's rotation to the camera frame."""

    point: SurfacePoint
    diffuse: wp.vec3
    share: float
    rotation: wp.mat33


@wp.func
def footprint_growth(pdf: float, samples: int):
    """Gives the growth of a path's footprint per metre: the width of a cone with one sample's share of directions."""
    return wp.min(wp.sqrt(4.0 / (PI * pdf * float(samples))), 1.0)


@cache
def make_brdf(gloss: bool) -> tuple[Any, Any, Any]:
    """Makes the functions `vertex_of`, `evaluate_brdf` and `sample_brdf`."""

    @wp.func
    def vertex_of(point: SurfacePoint, rotation: wp.mat33, sky: Sky, albedo: wp.vec3, gloss_of: wp.vec2, least: float):
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
                r = reflectances(sky, alpha, wp.dot(s.shading_normal, s.view))
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
        v.rotation = rotation
        v.point = s
        return v

    @wp.func
    def evaluate_brdf(v: PathVertex, l: wp.vec3):
        """Gives BRDF times cosine for direction l, and the density with which a path takes it; 0 below the surface."""
        cosine = wp.dot(v.point.shading_normal, l)
        if cosine <= 0.0 or wp.dot(v.point.normal, l) <= 0.0:
            return wp.vec3(0.0, 0.0, 0.0), 0.0
        value = v.diffuse * (cosine / PI)
        density = cosine / PI
        if wp.static(gloss):
            if v.point.alpha >= 0.0:
                value += cosine * specular(v.point.alpha, v.point.f0, v.point.shading_normal, v.point.view, l)
                density = (1.0 - v.share) * density + v.share * sample_density(
                    v.point.alpha, v.point.shading_normal, v.point.view, l
                )
        return value, density

    @wp.func
    def sample_brdf(v: PathVertex, u: wp.vec2):
        """Gives the direction that a path takes from its vertex for u in [0, 1)^2."""
        # One number chooses the lobe and, from what is left of it, the direction.
        if u[0] < v.share:
            return sample_direction(v.point.alpha, v.point.shading_normal, v.point.view, wp.vec2(u[0] / v.share, u[1]))
        return cosine_direction(v.point.shading_normal, v.rotation, wp.vec2((u[0] - v.share) / (1.0 - v.share), u[1]))

    return vertex_of, evaluate_brdf, sample_brdf
