"""Computes rectangular area lights: irradiance in closed form, soft shadows and gloss by samples frozen on the
surface."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.area_sample_kernels import light_area_sample, lobe_sample, specular_estimate
from nodes.renderer.lights.light_kernels import Lights
from nodes.renderer.lights.rectangle_kernels import Rectangle, rectangle_of, wholly_above
from nodes.renderer.lights.surface_point_kernels import SurfacePoint
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})

SHORT = wp.constant(0.9999)
"""Part of the way to an area light that must be free: a lamp's own surface may lie in its plane."""


@wp.struct
class AreaLight:
    """Holds what an area light of radiance 1 gives: still_lit: still casters let some of it through; irradiance for the
    diffuse term and reflected radiance of the specular one, with all casters and with the still ones alone."""

    still_lit: bool
    irradiance: float
    still_irradiance: float
    specular: wp.vec3
    still_specular: wp.vec3


@cache
def make_hull_test(trees: bool, merged: bool) -> Any:
    """Makes the function `may_shade_area`; arguments as of `make_occlusion`."""
    _, may_occlude = make_occlusion(trees, merged)

    @wp.func
    def may_shade_area(lights: Lights, casters: Casters, env: int, l: int, s: SurfacePoint, first: int, last: int):
        """Tells whether casters order[first..last) may be in the way of any of area light l: of the ball around it."""
        gap = lights.vector[env, l] - s.ray_origin
        far = wp.length(gap)
        radius = wp.length(lights.half_u[env, l]) + wp.length(lights.half_v[env, l])
        return may_occlude(casters, env, first, last, s.skip_instance, s.ray_origin, gap / far, far, radius)

    return may_shade_area


@cache
def make_area_shadows(shadows: bool, trees: bool, cached: bool, merged: bool) -> tuple[Any, Any]:
    """Makes the functions `may_be_shadowed` and `sample_visibility`; arguments as of `make_area_light`."""
    occluded, _ = make_occlusion(trees, merged)
    may_shade_area = make_hull_test(trees, merged)

    @wp.func
    def may_be_shadowed(lights: Lights, casters: Casters, env: int, l: int, s: SurfacePoint):
        """Tells whether still casters, and whether moving ones, may be in the way of any of a light."""
        still_test = wp.bool(False)
        move_test = wp.bool(False)
        if wp.static(shadows):
            if lights.shadow[l] == 1:
                moved = wp.int32(0)
                if wp.static(cached):
                    moved = casters.still
                    still_test = may_shade_area(lights, casters, env, l, s, 0, moved)
                move_test = may_shade_area(lights, casters, env, l, s, moved, casters.order.shape[0])
        return still_test, move_test

    @wp.func
    def sample_visibility(
        casters: Casters, env: int, s: SurfacePoint, towards: wp.vec3, still_test: bool, move_test: bool
    ):
        """Tells whether no still caster is on the way to a point of the light, and none at all; what needs no test is
        not."""
        still_visible = wp.bool(True)
        visible = wp.bool(True)
        if wp.static(shadows):
            moved = wp.int32(0)
            if wp.static(cached):
                moved = casters.still
            last = casters.order.shape[0]
            gap = towards - (s.ray_origin - s.position)
            length = wp.length(gap)
            ray = gap / length
            part = wp.int32(wp.static(0 if cached else 1))
            while part < 2 and visible:
                if (part == 0 and still_test) or (part == 1 and move_test):
                    first = wp.where(part == 0, 0, moved)
                    end = wp.where(part == 0, moved, last)
                    if occluded(casters, env, first, end, s.skip_instance, s.ray_origin, ray, SHORT * length):
                        visible = False
                        still_visible = part > 0
                part += 1
        return still_visible, visible

    return may_be_shadowed, sample_visibility


@cache
def make_area_light(shadows: bool, trees: bool, gloss: bool, cached: bool, merged: bool) -> Any:
    """Makes the function `area_light`: what one area light of unit radiance gives a surface point.

    The diffuse term is the closed form times the seen part of the samples' weight (a ratio estimator: exact, without
    noise, where nothing is in the way). The specular term joins samples of the light and of the lobe by the balance
    heuristic (Veach and Guibas, SIGGRAPH 1995).

    shadows: some area light has them. cached: still casters are told apart from moving ones; otherwise all count as
    moving. merged: as of `make_occlusion`. A ray through a scene takes long to compile: there is one place that has it.
    """
    may_be_shadowed, sample_visibility = make_area_shadows(shadows, trees, cached, merged)

    @wp.func
    def sample_of(r: Rectangle, s: SurfacePoint, by_light: bool, a: float, b: float):
        """Takes a sample of the light, or of the specular lobe."""
        if wp.static(gloss):
            if not by_light:
                return lobe_sample(r, s, a, b)
        return light_area_sample(r, s, a, b)

    @wp.func
    def sampled_area_light(
        casters: Casters,
        env: int,
        s: SurfacePoint,
        r: Rectangle,
        side: int,
        light: int,
        glossy: bool,
        still_test: bool,
        move_test: bool,
    ):
        """Gives the light by side^2 samples of it and, if `glossy`, as many of the lobe."""
        got = AreaLight()
        count = float(side * side)
        random = wp.rand_init(int(s.key), light)
        total = wp.float32(0.0)
        # Of the light first, then of the lobe.
        for n in range(wp.where(glossy, 2 * side * side, side * side)):
            k = n % (side * side)
            a = (float(k % side) + wp.randf(random)) / float(side)
            b = (float(k // side) + wp.randf(random)) / float(side)
            sample = sample_of(r, s, n < side * side, a, b)
            total += sample.weight
            if sample.hits_light:
                still_visible, visible = sample_visibility(casters, env, s, sample.towards, still_test, move_test)
                specular_term = wp.vec3(0.0, 0.0, 0.0)
                if wp.static(gloss):
                    if glossy:
                        specular_term = specular_estimate(s, sample, count)
                if still_visible:
                    got.still_irradiance += sample.weight
                    got.still_specular += specular_term
                if visible:
                    got.irradiance += sample.weight
                    got.specular += specular_term
        got.still_lit = got.still_irradiance > 0.0 or wp.max(got.still_specular) > 0.0
        if total > 0.0:
            # The ratio first, which is exactly 1 where all is seen.
            got.irradiance = r.flux * (got.irradiance / total)
            got.still_irradiance = r.flux * (got.still_irradiance / total)
        return got

    @wp.func
    def area_light(lights: Lights, casters: Casters, env: int, l: int, s: SurfacePoint):
        """Computes what light l of unit radiance gives a surface point."""
        got = AreaLight()
        r = rectangle_of(lights, env, l, s)
        if r.flux == 0.0:
            return got
        still_test, move_test = may_be_shadowed(lights, casters, env, l, s)
        glossy = wp.bool(False)
        if wp.static(gloss):
            glossy = s.alpha >= 0.0
        if still_test or move_test or glossy or not wholly_above(r, s.normal):
            return sampled_area_light(casters, env, s, r, lights.side, l, glossy, still_test, move_test)
        got.still_lit = True
        got.irradiance = r.flux
        got.still_irradiance = r.flux
        return got

    return area_light
