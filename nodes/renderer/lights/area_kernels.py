"""Rectangular area lights: irradiance in closed form, soft shadows and gloss by samples frozen on the surface."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.light_kernels import Lights, SurfacePoint
from nodes.renderer.materials.ggx_kernels import sample_density, sample_direction, specular
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})

SMALL = wp.constant(2.0e-3)
"""Radius of an area light, of its distance, below which the closed form has cancelled and a point is as exact."""

SHORT = wp.constant(0.9999)
"""Part of the way to an area light that must be free: a lamp's own surface may lie in its plane."""

LATTICE = wp.constant(
    wp.mat33(0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6),
)
"""Rotation of the lattice of the random numbers, so that no face of a box lies along its cells' borders."""


@wp.struct
class Rectangle:
    """Holds an area light as a surface point sees it: its middle from there, half-edges, and the normal of the side
    that emits; flux: irradiance for radiance 1 with nothing in the way, 0 where it lies behind or below."""

    centre: wp.vec3
    u: wp.vec3
    v: wp.vec3
    facing: wp.vec3
    area: float
    flux: float


@wp.struct
class AreaSample:
    """Holds a direction from a surface point in which an area light may lie.

    towards: from the point to the light's plane, with unit vector `ray`; cosine at the point. density [1/sr] of samples
    of the light that way. weight: of the diffuse term, 0 for a sample of the lobe. met: the light is there, above the
    surface.
    """

    towards: wp.vec3
    ray: wp.vec3
    cosine: float
    density: float
    weight: float
    met: bool


@wp.struct
class AreaLight:
    """Holds what an area light of radiance 1 gives: whether still casters let any of it through; irradiance of the
    diffuse term with all casters, and with still ones; radiance of the specular term likewise."""

    passes: bool
    full: float
    still: float
    full_shine: wp.vec3
    still_shine: wp.vec3


@wp.func
def cell_key(i: wp.uint32, j: wp.uint32, k: wp.uint32, instance: int):
    """Gives the key of the random numbers of a cell of an instance's frame.

    The spatial hash of Teschner et al. (VMV 2003); the generator's own hash mixes it further.
    """
    mixed = (i * wp.uint32(73856093)) ^ (j * wp.uint32(19349663)) ^ (k * wp.uint32(83492791))
    return mixed ^ (wp.uint32(instance) * wp.uint32(1640531513))


@wp.func
def frozen_key(q: wp.vec3, footprint: float, instance: int):
    """Gives the key of the random numbers at q in the instance's frame: one per cell of about a pixel, `footprint` [m]
    wide.

    Cells belong to the surface: a still one keeps its numbers for ever, a moving one takes them along. Their size is a
    power of 2, so that it changes only where the distance doubles.
    """
    cell = wp.pow(2.0, wp.ceil(wp.log2(footprint)))
    r = (LATTICE * q) / cell
    i = wp.uint32(int(wp.clamp(wp.floor(r[0]), -2.0e9, 2.0e9)))
    j = wp.uint32(int(wp.clamp(wp.floor(r[1]), -2.0e9, 2.0e9)))
    k = wp.uint32(int(wp.clamp(wp.floor(r[2]), -2.0e9, 2.0e9)))
    return cell_key(i, j, k, instance)


@wp.func
def edge_irradiance(a: wp.vec3, b: wp.vec3, n: wp.vec3):
    """Gives the angle between a and b times the cosine between n and their plane's normal."""
    c = wp.cross(a, b - a)
    s = wp.length(c)
    if s == 0.0:
        return 0.0
    return wp.atan2(s, wp.dot(a, b)) * wp.dot(c, n) / s


@wp.func
def rectangle_irradiance(centre: wp.vec3, u: wp.vec3, v: wp.vec3, n: wp.vec3):
    """Gives the irradiance [W/m^2] at the origin with normal n from a rectangle of radiance 1, from either side.

    Lambert's sum over the edges of the polygon, cut at the horizon (Arvo, Applications of Irradiance Tensors, 1995).
    """
    distance = wp.length(centre)
    if wp.dot(u, u) + wp.dot(v, v) < (SMALL * distance) * (SMALL * distance):
        ray = centre / distance
        normal = wp.cross(u, v)
        return 4.0 * wp.max(wp.dot(n, ray), 0.0) * wp.abs(wp.dot(normal, ray)) / distance / distance
    total = wp.float32(0.0)
    leave = wp.vec3(0.0, 0.0, 0.0)
    enter = wp.vec3(0.0, 0.0, 0.0)
    su = wp.float32(1.0)
    sv = wp.float32(1.0)
    for _k in range(4):
        a = centre + su * u + sv * v
        # Corners in turn: (1, 1), (-1, 1), (-1, -1), (1, -1).
        turned = su
        su = -sv
        sv = turned
        b = centre + su * u + sv * v
        above = wp.dot(a, n)
        after = wp.dot(b, n)
        if above > 0.0 or after > 0.0:
            if above <= 0.0:
                a = a + (above / (above - after)) * (b - a)
                enter = a
            elif after <= 0.0:
                b = a + (above / (above - after)) * (b - a)
                leave = b
            total += edge_irradiance(a, b, n)
    total += edge_irradiance(leave, enter, n)
    return 0.5 * wp.abs(total)


@wp.func
def rectangle_of(lights: Lights, env: int, l: int, s: SurfacePoint):
    """Gives area light l as a surface point sees it."""
    r = Rectangle()
    centre = lights.vector[env, l] - s.position
    u = lights.half_u[env, l]
    v = lights.half_v[env, l]
    cross = wp.cross(u, v)
    facing = wp.normalize(cross)
    if wp.dot(centre, facing) < 0.0:
        r.flux = rectangle_irradiance(centre, u, v, s.facing)
    r.centre = centre
    r.u = u
    r.v = v
    r.facing = facing
    r.area = 4.0 * wp.length(cross)
    return r


@wp.func
def wholly_above(r: Rectangle, normal: wp.vec3):
    """Tells whether no part of a rectangle lies below the surface."""
    return wp.dot(r.centre, normal) >= wp.abs(wp.dot(r.u, normal)) + wp.abs(wp.dot(r.v, normal))


@wp.func
def of_light(r: Rectangle, s: SurfacePoint, a: float, b: float):
    """Gives the sample towards the point (a, b) in [0, 1)^2 of a rectangle."""
    sample = AreaSample()
    towards = r.centre + (2.0 * a - 1.0) * r.u + (2.0 * b - 1.0) * r.v
    length = wp.length(towards)
    ray = towards / length
    cosine = wp.dot(s.facing, ray)
    leaving = -wp.dot(r.facing, ray)
    if cosine > 0.0 and leaving > 0.0:
        sample.weight = cosine * leaving / length / length
        sample.density = length * length / (leaving * r.area)
        sample.met = wp.dot(s.normal, ray) > 0.0
    sample.towards = towards
    sample.ray = ray
    sample.cosine = cosine
    return sample


@wp.func
def of_lobe(r: Rectangle, s: SurfacePoint, a: float, b: float):
    """Gives the sample of the specular lobe for (a, b) in [0, 1)^2."""
    sample = AreaSample()
    ray = sample_direction(s.alpha, s.facing, s.view, wp.vec2(a, b))
    cosine = wp.dot(s.facing, ray)
    facing = r.facing
    leaving = -wp.dot(facing, ray)
    if cosine > 0.0 and leaving > 0.0:
        centre = r.centre
        u = r.u
        v = r.v
        length = -wp.dot(centre, facing) / leaving
        towards = length * ray
        place = towards - centre
        within = wp.abs(wp.dot(place, u)) <= wp.dot(u, u) and wp.abs(wp.dot(place, v)) <= wp.dot(v, v)
        sample.met = within and wp.dot(s.normal, ray) > 0.0
        sample.density = length * length / (leaving * r.area)
        sample.towards = towards
    sample.ray = ray
    sample.cosine = cosine
    return sample


@wp.func
def glint_of(s: SurfacePoint, sample: AreaSample, count: float):
    """Gives the specular radiance by one of `count` samples of a light of radiance 1, taken of the light or of the
    lobe.

    The sum of both densities is the balance heuristic's.
    """
    brdf = specular(s.alpha, s.f0, s.facing, s.view, sample.ray)
    other = sample_density(s.alpha, s.facing, s.view, sample.ray)
    return (sample.cosine / (count * (sample.density + other))) * brdf


@cache
def make_area(shadows: bool, trees: bool, gloss: bool, cached: bool, joined: bool) -> Any:
    """Makes the function `area`: what one area light of unit radiance gives a surface point.

    The diffuse term is the closed form times the seen part of the samples' weight (a ratio estimator: exact, without
    noise, where nothing is in the way). The specular term joins samples of the light and of the lobe by the balance
    heuristic (Veach and Guibas, SIGGRAPH 1995).

    shadows: some area light has them. cached: still casters are told apart from moving ones; otherwise all count as
    moving. joined: as of `make_occlusion`. A ray through a scene takes long to compile: there is one place that has it.
    """
    occluded, crossed = make_occlusion(trees, joined)

    @wp.func
    def casters_near(lights: Lights, casters: Casters, env: int, l: int, s: SurfacePoint, r: Rectangle):
        """Tells whether still casters, and whether moving ones, may be in the way of any of a light."""
        still_test = wp.bool(False)
        move_test = wp.bool(False)
        if wp.static(shadows):
            if lights.shadow[l] == 1:
                moved = wp.int32(0)
                last = casters.order.shape[0]
                gap = lights.vector[env, l] - s.lift
                far = wp.length(gap)
                reach = wp.length(r.u) + wp.length(r.v)
                ray = gap / far
                if wp.static(cached):
                    moved = casters.still
                    still_test = crossed(casters, env, 0, moved, s.alone, s.lift, ray, far, reach)
                move_test = crossed(casters, env, moved, last, s.alone, s.lift, ray, far, reach)
        return still_test, move_test

    @wp.func
    def seen(casters: Casters, env: int, s: SurfacePoint, towards: wp.vec3, still_test: bool, move_test: bool):
        """Tells whether no still caster is on the way to a point of the light, and none at all; what needs no test is
        not."""
        open = wp.bool(True)
        free = wp.bool(True)
        if wp.static(shadows):
            moved = wp.int32(0)
            if wp.static(cached):
                moved = casters.still
            last = casters.order.shape[0]
            gap = towards - (s.lift - s.position)
            length = wp.length(gap)
            ray = gap / length
            part = wp.int32(wp.static(0 if cached else 1))
            while part < 2 and free:
                if (part == 0 and still_test) or (part == 1 and move_test):
                    first = wp.where(part == 0, 0, moved)
                    end = wp.where(part == 0, moved, last)
                    if occluded(casters, env, first, end, s.alone, s.lift, ray, SHORT * length):
                        free = False
                        open = part > 0
                part += 1
        return open, free

    @wp.func
    def sample_of(r: Rectangle, s: SurfacePoint, by_light: bool, a: float, b: float):
        """Takes a sample of the light, or of the specular lobe."""
        if wp.static(gloss):
            if not by_light:
                return of_lobe(r, s, a, b)
        return of_light(r, s, a, b)

    @wp.func
    def sampled(
        casters: Casters,
        env: int,
        s: SurfacePoint,
        r: Rectangle,
        side: int,
        light: int,
        shiny: bool,
        still_test: bool,
        move_test: bool,
    ):
        """Gives the light by side^2 samples of it and, if `shiny`, as many of the lobe."""
        got = AreaLight()
        count = float(side * side)
        random = wp.rand_init(int(s.key), light)
        total = wp.float32(0.0)
        # Of the light first, then of the lobe.
        for n in range(wp.where(shiny, 2 * side * side, side * side)):
            k = n % (side * side)
            a = (float(k % side) + wp.randf(random)) / float(side)
            b = (float(k // side) + wp.randf(random)) / float(side)
            sample = sample_of(r, s, n < side * side, a, b)
            total += sample.weight
            if sample.met:
                open, free = seen(casters, env, s, sample.towards, still_test, move_test)
                glint = wp.vec3(0.0, 0.0, 0.0)
                if wp.static(gloss):
                    if shiny:
                        glint = glint_of(s, sample, count)
                if open:
                    got.still += sample.weight
                    got.still_shine += glint
                if free:
                    got.full += sample.weight
                    got.full_shine += glint
        got.passes = got.still > 0.0 or wp.max(got.still_shine) > 0.0
        if total > 0.0:
            # The ratio first, which is exactly 1 where all is seen.
            got.full = r.flux * (got.full / total)
            got.still = r.flux * (got.still / total)
        return got

    @wp.func
    def area(lights: Lights, casters: Casters, env: int, l: int, s: SurfacePoint):
        """Computes what light l of unit radiance gives a surface point."""
        got = AreaLight()
        r = rectangle_of(lights, env, l, s)
        if r.flux == 0.0:
            return got
        still_test, move_test = casters_near(lights, casters, env, l, s, r)
        shiny = wp.bool(False)
        if wp.static(gloss):
            shiny = s.alpha >= 0.0
        if still_test or move_test or shiny or not wholly_above(r, s.normal):
            return sampled(casters, env, s, r, lights.side, l, shiny, still_test, move_test)
        got.passes = True
        got.full = r.flux
        got.still = r.flux
        return got

    return area
