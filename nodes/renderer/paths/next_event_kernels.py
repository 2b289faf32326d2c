"""Computes next-event estimation: what a vertex of a path reflects of a light, a glowing triangle or the sky's map that
it aims at."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.area_kernels import SHORT
from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import AREA, DIRECTIONAL, FAR, SPOT, Lights, spot_falloff
from nodes.renderer.lights.sky_kernels import Sky, make_sky
from nodes.renderer.paths.brdf_kernels import PathVertex, make_brdf
from nodes.renderer.paths.sampling_kernels import (
    PathSources,
    place_in_entry,
    search_cdf,
    sky_density,
    sky_direction,
)
from nodes.renderer.paths.vertex_kernels import PathMeshes
from nodes.renderer.raster.surface_kernels import Surfaces
from nodes.renderer.shading.radiance_kernels import luminance
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})


@wp.func
def sample_light(lights: Lights, env: int, l: int, p: wp.vec3, normal: wp.vec3, u: wp.vec2, footprint: float):
    """Gives the unit vector from p to a light, or to its point u, the length of the shadow ray, and the irradiance over
    the cosine.

    A lamp lights the surface as from at least the `footprint` of the path's last part above it. On a plane that keeps
    its power; one that is further away stays where it is, for its light is even over the footprint already, and of one
    that is raised the walls of a room, which end or bend, get less.
    """
    vector = lights.vector[env, l]
    kind = lights.kind[l]
    if kind == DIRECTIONAL:
        return vector, FAR, 1.0
    vector = vector - p
    if kind == AREA:
        vector += (2.0 * u[0] - 1.0) * lights.half_u[env, l] + (2.0 * u[1] - 1.0) * lights.half_v[env, l]
    length = wp.length(vector)
    ray = vector / length
    cosine = wp.dot(normal, ray)
    if cosine <= 0.0:
        return ray, length, 0.0
    slope = footprint / length
    raised = wp.max(slope * slope - cosine * cosine, 0.0)
    spread = 1.0 + raised
    strength = wp.sqrt(cosine * cosine + raised) / (cosine * spread * wp.sqrt(spread)) / length / length
    if kind == SPOT:
        strength *= spot_falloff(lights, env, l, ray)
    if kind == AREA:
        leaving = -wp.dot(wp.cross(lights.half_u[env, l], lights.half_v[env, l]), ray)
        return ray, SHORT * length, 4.0 * wp.max(leaving, 0.0) * strength
    return ray, length, strength


@cache
def make_next_event(f: Features) -> tuple[Any, Any, Any]:
    """Makes the functions `next_event_light`, `next_event_emitter` and `next_event_sky`."""
    background, _, _ = make_sky(f.sky_map)
    occluded, _ = make_occlusion(f.trees, f.merged)
    _, evaluate_brdf, _ = make_brdf(f.gloss)

    @wp.func
    def next_event_light(
        lights: Lights,
        casters: Casters,
        env: int,
        v: PathVertex,
        footprint: float,
        u: wp.vec2,
        choice: float,
    ):
        """Gives what a vertex reflects of one light, over the chance that it is that one."""
        total = wp.float32(0.0)
        chosen = wp.int32(-1)
        weight = wp.float32(0.0)
        colour = wp.vec3(0.0, 0.0, 0.0)
        rest = choice
        for l in range(lights.kind.shape[0]):
            ray, length, strength = sample_light(lights, env, l, v.point.position, v.point.shading_normal, u, footprint)
            if strength > 0.0:
                value, _ = evaluate_brdf(v, ray)
                value = wp.cw_mul(value, strength * lights.colour[env, l])
                given = luminance(value)
                if given > 0.0:
                    total += given
                    # One number chooses among all: what is left of it is as uniform as it was.
                    chance = given / total
                    if rest < chance:
                        rest = rest / chance
                        chosen = l
                        weight = given
                        colour = value
                    else:
                        rest = (rest - chance) / wp.max(1.0 - chance, 1.0e-9)
        if chosen < 0:
            return colour
        if lights.shadow[chosen] == 1:
            ray, length, strength = sample_light(
                lights, env, chosen, v.point.position, v.point.shading_normal, u, footprint
            )
            last = casters.order.shape[0]
            if occluded(casters, env, 0, last, v.point.skip_instance, v.point.ray_origin, ray, length):
                return wp.vec3(0.0, 0.0, 0.0)
        return (total / weight) * colour

    @wp.func
    def next_event_emitter(
        sources: PathSources,
        surfaces: Surfaces,
        meshes: PathMeshes,
        casters: Casters,
        env: int,
        v: PathVertex,
        u: wp.vec2,
    ):
        """Gives what a vertex reflects of a point on a glowing triangle, weighted against finding it by chance."""
        zero = wp.vec3(0.0, 0.0, 0.0)
        g = search_cdf(sources.emitter_cdf, u[0])
        root = wp.sqrt(place_in_entry(sources.emitter_cdf, g, u[0]))
        i = sources.emitter_instance[g]
        a = sources.emitter_corners[g, 0]
        b = sources.emitter_corners[g, 1]
        c = sources.emitter_corners[g, 2]
        turn = casters.rotation[env, i]
        place = turn * ((1.0 - root) * a + (root * (1.0 - u[1])) * b + (root * u[1]) * c) + casters.translation[env, i]
        gap = place - v.point.ray_origin
        length = wp.length(gap)
        if i == v.point.skip_instance or length == 0.0:
            return zero
        ray = gap / length
        leaving = -wp.dot(turn * wp.normalize(wp.cross(b - a, c - a)), ray)
        if meshes.two_sided[i] == 1:
            leaving = wp.abs(leaving)
        if leaving <= 0.0:
            return zero
        value, other = evaluate_brdf(v, ray)
        if other == 0.0:
            return zero
        emission = surfaces.emission[surfaces.material[i]]
        density = luminance(emission) * sources.emitter_density * (length / leaving * length)
        last = casters.order.shape[0]
        if occluded(casters, env, 0, last, v.point.skip_instance, v.point.ray_origin, ray, SHORT * length):
            return zero
        return wp.cw_mul(value, emission) / (density + other)

    @wp.func
    def next_event_sky(
        sources: PathSources,
        sky: Sky,
        casters: Casters,
        env: int,
        v: PathVertex,
        u: wp.vec2,
    ):
        """Gives what a vertex reflects of a direction of the map, weighted against finding it by chance."""
        zero = wp.vec3(0.0, 0.0, 0.0)
        world = sky_direction(sources, u)
        ray = wp.transpose(sky.camera[env]) * world
        value, other = evaluate_brdf(v, ray)
        if other == 0.0:
            return zero
        last = casters.order.shape[0]
        if occluded(casters, env, 0, last, v.point.skip_instance, v.point.ray_origin, ray, FAR):
            return zero
        return wp.cw_mul(value, background(sky, env, ray)) / (sky_density(sources, world) + other)

    return next_event_light, next_event_emitter, next_event_sky
