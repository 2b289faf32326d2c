"""Makes the vertices of paths: what a pixel shows, and what a path's ray hits, with material and averaged texture."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.features import Features
from nodes.renderer.lights.sky_kernels import Sky
from nodes.renderer.lights.surface_point_kernels import SurfacePoint, with_ray_origin
from nodes.renderer.paths.brdf_kernels import make_brdf
from nodes.renderer.paths.first_hit_kernels import RayHit
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import (
    Pixel,
    SurfaceHit,
    Surfaces,
    VisibilityBuffer,
    make_surface,
    shading_normal_of,
    surface_hit,
    tint_of,
)
from nodes.renderer.shadows.ray_kernels import Casters
from nodes.renderer.textures.texture_kernels import bilinear

wp.set_module_options({"enable_backward": False})

LEAST_ALPHA = wp.constant(0.1)
"""Narrowest lobe from the second surface point on: a lamp found through a mirror by chance is one bright dot."""


@wp.struct
class PathMeshes:
    """Holds the meshes that paths meet. first, two_sided [I]: first triangle of an instance, 1 where its backs are
    seen; points: vertices in their instances' frames."""

    first: wp.array(dtype=int)
    two_sided: wp.array(dtype=int)
    points: wp.array(dtype=wp.vec3)


@wp.func
def path_hit(
    surfaces: Surfaces, meshes: PathMeshes, casters: Casters, env: int, start: wp.vec3, ray: wp.vec3, ray_hit: RayHit
):
    """Gives the surface that a path's ray meets; its `normal` is towards the ray's start."""
    i = ray_hit.instance
    t = meshes.first[i] + ray_hit.face
    position = start + ray_hit.distance * ray
    return surface_hit(t, i, casters.rotation[env, i], surfaces.normals[t], ray, position)


@wp.func
def texture_over_footprint(
    surfaces: Surfaces, meshes: PathMeshes, i: int, t: int, w0: float, w1: float, footprint: float
):
    """Gives the texture of instance i at a point of triangle t, averaged over `footprint` [m]."""
    place = surfaces.textures.place[i]
    j = 3 * t
    uv0 = surfaces.uv[j]
    uv1 = surfaces.uv[j + 1]
    uv2 = surfaces.uv[j + 2]
    k = surfaces.triangles[t]
    a = meshes.points[k[0]]
    area = wp.length(wp.cross(meshes.points[k[1]] - a, meshes.points[k[2]] - a))
    e = uv1 - uv0
    f = uv2 - uv0
    level = surfaces.textures.levels[place[0]]
    texels = wp.abs(e[0] * f[1] - e[1] * f[0]) * float(level[1]) * float(level[2])
    lod = wp.log2(wp.max(footprint * wp.sqrt(texels / wp.max(area, 1.0e-30)), 1.0))
    lod = wp.min(lod, float(place[1] - 1))
    base = int(lod)
    uv = w0 * uv0 + w1 * uv1 + (1.0 - w0 - w1) * uv2
    fine = bilinear(surfaces.textures.texels, surfaces.textures.levels[place[0] + base], uv)
    above = surfaces.textures.levels[place[0] + wp.min(base + 1, place[1] - 1)]
    coarse = bilinear(surfaces.textures.texels, above, uv)
    return fine + (lod - float(base)) * (coarse - fine)


@cache
def make_albedo(textures: bool, vertex_colours: bool) -> Any:
    """Makes the function of the albedo where a path meets a surface."""

    @wp.func
    def albedo_at(surfaces: Surfaces, meshes: PathMeshes, i: int, t: int, w0: float, w1: float, footprint: float):
        """Gives the albedo where a path meets a triangle, its texture averaged over the path's `footprint` [m]."""
        albedo = surfaces.albedo[surfaces.material[i]]
        if wp.static(textures):
            if surfaces.textures.place[i][1] > 0:
                albedo = wp.cw_mul(albedo, texture_over_footprint(surfaces, meshes, i, t, w0, w1, footprint))
        if wp.static(vertex_colours):
            albedo = wp.cw_mul(albedo, tint_of(surfaces, t, wp.vec3(w0, w1, 1.0 - w0 - w1)))
        return albedo

    return albedo_at


@cache
def make_vertices(f: Features) -> tuple[Any, Any]:
    """Makes the functions `first_vertex` and `next_vertex`."""
    surface = make_surface(f.textures, f.smooth, f.vertex_colours)
    vertex_of, _, _ = make_brdf(f.gloss)
    albedo_at = make_albedo(f.textures, f.vertex_colours)

    @wp.func
    def first_vertex(
        view: CameraView,
        pixel: Pixel,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        sky: Sky,
        casters: Casters,
        hit: SurfaceHit,
    ):
        """Gives what a pixel sees, as the vertex that its paths begin at."""
        s = SurfacePoint()
        s.position = hit.position
        s.normal = hit.normal
        albedo, shading_normal = surface(view, pixel, seen, surfaces, hit)
        s.shading_normal = shading_normal
        s.view = -wp.normalize(hit.ray)
        gloss = surfaces.gloss[surfaces.material[hit.instance]]
        return vertex_of(with_ray_origin(casters, s, hit), hit.rotation, sky, albedo, gloss, 0.0)

    @wp.func
    def next_vertex(
        surfaces: Surfaces,
        sky: Sky,
        casters: Casters,
        meshes: PathMeshes,
        hit: SurfaceHit,
        w0: float,
        w1: float,
        footprint: float,
    ):
        """Gives what a path of this footprint [m] meets. w0, w1: barycentric coordinates of the first two corners."""
        s = SurfacePoint()
        s.position = hit.position
        s.normal = hit.normal
        s.view = -hit.ray
        s.shading_normal = hit.normal
        if wp.static(f.smooth):
            s.shading_normal = shading_normal_of(surfaces, hit, wp.vec3(w0, w1, 1.0 - w0 - w1))
        gloss = surfaces.gloss[surfaces.material[hit.instance]]
        albedo = albedo_at(surfaces, meshes, hit.instance, hit.triangle, w0, w1, footprint)
        return vertex_of(with_ray_origin(casters, s, hit), hit.rotation, sky, albedo, gloss, LEAST_ALPHA)

    return first_vertex, next_vertex
