"""Computes rectangular area lights: irradiance in closed form, soft shadows and gloss by samples frozen on the
surface."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.area_sample_kernels import glint_of, of_light, of_lobe
from nodes.renderer.lights.light_kernels import Lights, SurfacePoint
from nodes.renderer.lights.rectangle_kernels import Rectangle, rectangle_of, wholly_above
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})

SHORT = wp.constant(0.9999)
"""Part of the way to an area light that must be free: a lamp's own surface may lie in its plane."""


@wp.struct
class AreaLight:
    """Holds what an area light of radiance 1 gives: whether still casters let any of it through; irradiance of the
    diffuse term with all casters, and with still ones; radiance of the specular term likewise."""

    passes: bool
    full: float
    still: float
    full_shine: wp.vec3
    still_shine: wp.vec3


@cache
def make_area_shadows(shadows: bool, trees: bool, cached: bool, joined: bool) -> tuple[Any, Any]:
    """Makes the functions `casters_near` and `seen`; arguments as of `make_area`."""
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

    return casters_near, seen


@cache
def make_area(shadows: bool, trees: bool, gloss: bool, cached: bool, joined: bool) -> Any:
    """Makes the function `area`: what one area light of unit radiance gives a surface point.

    The diffuse term is the closed form times the seen part of the samples' weight (a ratio estimator: exact, without
    noise, where nothing is in the way). The specular term joins samples of the light and of the lobe by the balance
    heuristic (Veach and Guibas, SIGGRAPH 1995).

    shadows: some area light has them. cached: still casters are told apart from moving ones; otherwise all count as
    moving. joined: as of `make_occlusion`. A ray through a scene takes long to compile: there is one place that has it.
    """
    casters_near, seen = make_area_shadows(shadows, trees, cached, joined)

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
