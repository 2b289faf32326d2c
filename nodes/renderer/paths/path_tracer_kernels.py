"""Follows one path from a seen point, from vertex to vertex, with the light that it finds."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import FAR, Lights
from nodes.renderer.lights.sky_kernels import Sky, make_sky
from nodes.renderer.paths.brdf_kernels import PathVertex, footprint_growth, make_brdf
from nodes.renderer.paths.first_hit_kernels import make_first_hit
from nodes.renderer.paths.next_event_kernels import make_next_event
from nodes.renderer.paths.sampling_kernels import (
    EMITTER,
    LIGHT_PROXY,
    PathSources,
    Sampler,
    fraction,
    sample_square,
    sky_density,
)
from nodes.renderer.paths.vertex_kernels import PathMeshes, make_vertices, path_hit
from nodes.renderer.raster.surface_kernels import SurfaceHit, Surfaces
from nodes.renderer.shading.radiance_kernels import luminance
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})

LIGHT_DRAWS = wp.constant(64)
ROULETTE_DRAWS = wp.constant(128)
"""What is added to the number of a bounce for the random point on a light, and for what ends paths at random."""


@wp.struct
class PathLimits:
    """Holds bounces, samples and roulette (0 or 1) of `paths.PathOptions`."""

    bounces: int
    samples: int
    roulette: int


@wp.func
def emitter_pdf(surfaces: Surfaces, sources: PathSources, hit: SurfaceHit, distance: float):
    """Gives the density [1/sr] with which next-event estimation gives the way to a point of a glowing triangle."""
    chance = luminance(surfaces.emission[surfaces.material[hit.instance]]) * sources.emitter_density
    return chance * (distance / wp.max(wp.abs(wp.dot(hit.normal, hit.ray)), 1.0e-6) * distance)


@wp.func
def roulette_ends(sampler: Sampler, bounce: int, stay: float):
    """Tells whether a path that goes on with the chance `stay` does not."""
    state = wp.rand_init(sampler.instance * 7919 + bounce + ROULETTE_DRAWS, sampler.k)
    return fraction(wp.randf(state) + sampler.shift[1]) >= stay


@cache
def make_path_tracer(f: Features, emitters: bool, only_lights: bool) -> Any:
    """Makes the function `path_radiance`. emitters, only_lights: as of `path_kernels.make_paths`."""
    next_event_light, next_event_emitter, next_event_sky = make_next_event(f)
    background, _, _ = make_sky(f.sky_map)
    occluded, _ = make_occlusion(f.trees, f.merged)
    first_hit = make_first_hit(f.trees, f.merged)
    _, evaluate_brdf, sample_brdf = make_brdf(f.gloss)
    _, next_vertex = make_vertices(f)

    @wp.func
    def sky_found(sources: PathSources, sky: Sky, env: int, ray: wp.vec3, density: float):
        """Gives the sky's radiance on a path that took this ray with this density, weighted against aiming at it."""
        shine = background(sky, env, ray)
        if wp.static(f.sky_map):
            shine = (density / (density + sky_density(sources, sky.camera[env] * ray))) * shine
        return shine

    # One call for all paths of a pixel: the structs that it takes are copied by each.
    @wp.func
    def path_radiance(
        limits: PathLimits,
        instance: int,
        shift: wp.vec4,
        env: int,
        first: PathVertex,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        meshes: PathMeshes,
        sources: PathSources,
    ):
        """Gives the mean radiance that `samples` paths bring to their first vertex, on an instance, with its frozen
        shift."""
        total = wp.vec3(0.0, 0.0, 0.0)
        sampler = Sampler()
        sampler.count = limits.samples
        sampler.instance = instance
        sampler.shift = shift
        for k in range(limits.samples):
            sampler.k = k
            v = first
            throughput = wp.vec3(1.0, 1.0, 1.0)
            footprint = wp.float32(0.0)
            # For lamps: points of all paths lie as densely on a room's walls after several parts as after one.
            last_footprint = wp.float32(0.0)
            for bounce in range(limits.bounces + 1):
                u = sample_square(sampler, bounce, wp.vec2(shift[0], shift[1]))
                if wp.static(f.lit):
                    # At the seen point, which is vertex 0, the light of lights is there already.
                    if bounce > 0:
                        place = sample_square(sampler, bounce + LIGHT_DRAWS, wp.vec2(shift[2], shift[3]))
                        choice = fraction(u[0] + shift[3])
                        total += wp.cw_mul(
                            throughput, next_event_light(lights, casters, env, v, last_footprint, place, choice)
                        )
                if wp.static(emitters):
                    place = sample_square(sampler, bounce, wp.vec2(shift[3], shift[2]))
                    total += wp.cw_mul(
                        throughput, next_event_emitter(sources, surfaces, meshes, casters, env, v, place)
                    )
                if wp.static(f.sky_map):
                    place = sample_square(sampler, bounce, wp.vec2(shift[2], shift[3]))
                    total += wp.cw_mul(throughput, next_event_sky(sources, sky, casters, env, v, place))
                if wp.static(only_lights):
                    if bounce == limits.bounces:
                        break
                ray = sample_brdf(v, u)
                value, density = evaluate_brdf(v, ray)
                if density == 0.0:
                    break
                throughput = wp.cw_mul(throughput, value / density)
                if wp.static(not emitters):
                    if bounce == limits.bounces:
                        # Only whether the sky is there matters any more.
                        last = casters.order.shape[0]
                        if not occluded(casters, env, 0, last, v.point.skip_instance, v.point.ray_origin, ray, FAR):
                            total += wp.cw_mul(throughput, sky_found(sources, sky, env, ray, density))
                        break
                ray_hit = first_hit(casters, env, v.point.skip_instance, v.point.ray_origin, ray, FAR)
                if ray_hit.instance < 0:
                    total += wp.cw_mul(throughput, sky_found(sources, sky, env, ray, density))
                    break
                hit = path_hit(surfaces, meshes, casters, env, v.point.ray_origin, ray, ray_hit)
                if hit.side < 0.0 and meshes.two_sided[hit.instance] == 0:
                    break
                if sources.emitter_kind[hit.instance] == LIGHT_PROXY:
                    break
                if wp.static(emitters):
                    if sources.emitter_kind[hit.instance] == EMITTER:
                        emission = surfaces.emission[surfaces.material[hit.instance]]
                        chance = emitter_pdf(surfaces, sources, hit, ray_hit.distance)
                        total += (density / (density + chance)) * wp.cw_mul(throughput, emission)
                if bounce == limits.bounces:
                    break
                if limits.roulette == 1 and bounce > 0:
                    stay = wp.min(wp.max(throughput), 1.0)
                    if roulette_ends(sampler, bounce, stay):
                        break
                    throughput = throughput / stay
                last_footprint = ray_hit.distance * footprint_growth(density, limits.samples)
                footprint += last_footprint
                v = next_vertex(surfaces, sky, casters, meshes, hit, ray_hit.w0, ray_hit.w1, footprint)
        return total / float(limits.samples)

    return path_radiance
