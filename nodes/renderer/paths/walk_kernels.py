"""Follows one path from a seen point, from vertex to vertex, with the light that it finds."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import FAR, Lights, SurfacePoint
from nodes.renderer.lights.sky_kernels import Sky, make_sky
from nodes.renderer.paths.aim_kernels import make_aims
from nodes.renderer.paths.sampling_kernels import GLOWING, PICTURE, Numbers, Sources, around, point_of, sky_density
from nodes.renderer.paths.surface_kernels import Bodies, PathVertex, lifted, make_albedo, make_reflection, spread_of
from nodes.renderer.paths.trace_kernels import Hit, make_first_hit
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import (
    Face,
    Pixel,
    Seen,
    Surfaces,
    make_surface,
    side_of,
    smooth_normal,
)
from nodes.renderer.shading.radiance_kernels import luminance
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})

LEAST_ALPHA = wp.constant(0.1)
"""Narrowest lobe from the second surface point on: a lamp found through a mirror by chance is one bright dot."""

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
def met_face(surfaces: Surfaces, bodies: Bodies, casters: Casters, env: int, start: wp.vec3, ray: wp.vec3, hit: Hit):
    """Finds where a ray meets the triangle that it hits; `normal` is towards its start."""
    face = Face()
    i = hit.instance
    t = bodies.first[i] + hit.face
    turn = casters.rotation[env, i]
    normal = turn * surfaces.normals[t]
    side = side_of(normal, ray)
    face.triangle = t
    face.instance = i
    face.ray = ray
    face.position = start + hit.distance * ray
    face.turn = turn
    face.normal = side * normal
    face.side = side
    return face


@wp.func
def aim_density(surfaces: Surfaces, sources: Sources, face: Face, distance: float):
    """Gives the density [1/sr] with which aiming at glowing triangles gives the way to a point of one."""
    chance = luminance(surfaces.emission[surfaces.material[face.instance]]) * sources.glow_density
    return chance * (distance / wp.max(wp.abs(wp.dot(face.normal, face.ray)), 1.0e-6) * distance)


@wp.func
def ends_by_chance(numbers: Numbers, bounce: int, stay: float):
    """Tells whether a path that goes on with the chance `stay` does not."""
    state = wp.rand_init(numbers.instance * 7919 + bounce + ROULETTE_DRAWS, numbers.k)
    return around(wp.randf(state) + numbers.shift[1]) >= stay


@cache
def make_vertices(f: Features) -> tuple[Any, Any]:
    """Makes the functions `first_vertex` and `next_vertex`."""
    surface = make_surface(f.textures, f.smooth, f.tinted)
    vertex_of, _, _ = make_reflection(f.gloss)
    albedo_at = make_albedo(f.textures, f.tinted)

    @wp.func
    def first_vertex(
        view: CameraView, pixel: Pixel, seen: Seen, surfaces: Surfaces, sky: Sky, casters: Casters, face: Face
    ):
        """Gives what a pixel sees, as the vertex that its paths begin at."""
        s = SurfacePoint()
        s.position = face.position
        s.normal = face.normal
        albedo, facing = surface(view, pixel, seen, surfaces, face)
        s.facing = facing
        s.view = -wp.normalize(face.ray)
        gloss = surfaces.gloss[surfaces.material[face.instance]]
        return vertex_of(lifted(casters, s, face.instance, face.side), face.turn, sky, albedo, gloss, 0.0)

    @wp.func
    def next_vertex(
        surfaces: Surfaces, sky: Sky, casters: Casters, bodies: Bodies, face: Face, w0: float, w1: float, width: float
    ):
        """Gives what a path of this width [m] meets, with the weights of its first two corners."""
        s = SurfacePoint()
        facing = face.normal
        s.position = face.position
        s.normal = facing
        s.view = -face.ray
        if wp.static(f.smooth):
            n = smooth_normal(surfaces, face.triangle, wp.vec3(w0, w1, 1.0 - w0 - w1))
            if wp.dot(n, n) > 0.0:
                facing = face.side * wp.normalize(face.turn * n)
        s.facing = facing
        gloss = surfaces.gloss[surfaces.material[face.instance]]
        albedo = albedo_at(surfaces, bodies, face.instance, face.triangle, w0, w1, width)
        return vertex_of(lifted(casters, s, face.instance, face.side), face.turn, sky, albedo, gloss, LEAST_ALPHA)

    return first_vertex, next_vertex


@cache
def make_walk(f: Features, glowing: bool, dark: bool) -> Any:
    """Makes the function `walk`. glowing, dark: as of `path_kernels.make_paths`."""
    of_lights, of_glow, of_sky = make_aims(f)
    background, _, _ = make_sky(f.mapped)
    occluded, _ = make_occlusion(f.trees, f.joined)
    first_hit = make_first_hit(f.trees, f.joined)
    _, reflected, onward = make_reflection(f.gloss)
    _, next_vertex = make_vertices(f)

    @wp.func
    def sky_found(sources: Sources, sky: Sky, env: int, ray: wp.vec3, density: float):
        """Gives the sky's radiance on a path that took this ray with this density, weighted against aiming at it."""
        shine = background(sky, env, ray)
        if wp.static(f.mapped):
            shine = (density / (density + sky_density(sources, sky.camera[env] * ray))) * shine
        return shine

    # One call for all paths of a pixel: the structs that it takes are copied by each.
    @wp.func
    def walk(
        limits: PathLimits,
        instance: int,
        shift: wp.vec4,
        env: int,
        first: PathVertex,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        bodies: Bodies,
        sources: Sources,
    ):
        """Gives the mean radiance that `samples` paths bring to their first vertex, on an instance, with its frozen
        shift."""
        total = wp.vec3(0.0, 0.0, 0.0)
        numbers = Numbers()
        numbers.count = limits.samples
        numbers.instance = instance
        numbers.shift = shift
        for k in range(limits.samples):
            numbers.k = k
            v = first
            through = wp.vec3(1.0, 1.0, 1.0)
            width = wp.float32(0.0)
            # For lamps: points of all paths lie as densely on a room's walls after several parts as after one.
            last_width = wp.float32(0.0)
            for bounce in range(limits.bounces + 1):
                u = point_of(numbers, bounce, wp.vec2(shift[0], shift[1]))
                if wp.static(f.lit):
                    # At the seen point, which is vertex 0, the light of lights is there already.
                    if bounce > 0:
                        place = point_of(numbers, bounce + LIGHT_DRAWS, wp.vec2(shift[2], shift[3]))
                        choice = around(u[0] + shift[3])
                        total += wp.cw_mul(through, of_lights(lights, casters, env, v, last_width, place, choice))
                if wp.static(glowing):
                    place = point_of(numbers, bounce, wp.vec2(shift[3], shift[2]))
                    total += wp.cw_mul(through, of_glow(sources, surfaces, bodies, casters, env, v, place))
                if wp.static(f.mapped):
                    place = point_of(numbers, bounce, wp.vec2(shift[2], shift[3]))
                    total += wp.cw_mul(through, of_sky(sources, sky, casters, env, v, place))
                if wp.static(dark):
                    if bounce == limits.bounces:
                        break
                ray = onward(v, u)
                value, density = reflected(v, ray)
                if density == 0.0:
                    break
                through = wp.cw_mul(through, value / density)
                if wp.static(not glowing):
                    if bounce == limits.bounces:
                        # Only whether the sky is there matters any more.
                        last = casters.order.shape[0]
                        if not occluded(casters, env, 0, last, v.point.alone, v.point.lift, ray, FAR):
                            total += wp.cw_mul(through, sky_found(sources, sky, env, ray, density))
                        break
                hit = first_hit(casters, env, v.point.alone, v.point.lift, ray, FAR)
                if hit.instance < 0:
                    total += wp.cw_mul(through, sky_found(sources, sky, env, ray, density))
                    break
                face = met_face(surfaces, bodies, casters, env, v.point.lift, ray, hit)
                if face.side < 0.0 and bodies.two_sided[face.instance] == 0:
                    break
                if sources.glows[face.instance] == PICTURE:
                    break
                if wp.static(glowing):
                    if sources.glows[face.instance] == GLOWING:
                        emission = surfaces.emission[surfaces.material[face.instance]]
                        chance = aim_density(surfaces, sources, face, hit.distance)
                        total += (density / (density + chance)) * wp.cw_mul(through, emission)
                if bounce == limits.bounces:
                    break
                if limits.roulette == 1 and bounce > 0:
                    stay = wp.min(wp.max(through), 1.0)
                    if ends_by_chance(numbers, bounce, stay):
                        break
                    through = through / stay
                last_width = hit.distance * spread_of(density, limits.samples)
                width += last_width
                v = next_vertex(surfaces, sky, casters, bodies, face, hit.w0, hit.w1, width)
        return total / float(limits.samples)

    return walk
