"""Sums what all lights give a surface point."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.area_kernels import make_area
from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import AREA, DirectLight, Lights, SurfacePoint, make_directions
from nodes.renderer.materials.ggx_kernels import specular
from nodes.renderer.shadows.grid_kernels import Grid, hidden_from
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})


@cache
def make_delta(f: Features) -> tuple[Any, Any]:
    """Makes the functions `idle` and `of_delta` of lights without size."""
    occluded, _ = make_occlusion(f.trees, f.joined)
    towards, idle = make_directions(f.directional, f.point, f.spot)

    @wp.func(inline=True)
    def reaches(
        lights: Lights,
        casters: Casters,
        grid: Grid,
        env: int,
        l: int,
        s: SurfacePoint,
        ray: wp.vec3,
        length: float,
        known: bool,
        bits: wp.uint32,
    ):
        """Tells whether still casters let a light without size through, and whether all do."""
        moved = wp.int32(0)
        last = casters.order.shape[0]
        open = wp.bool(True)
        free = wp.bool(True)
        if lights.shadow[l] == 1:
            if wp.static(f.grids):
                if grid.of[l] >= 0:
                    free = not hidden_from(casters, grid, grid.of[l], env, s.alone, s.lift, ray, length)
                    return free, free
            if wp.static(f.cached):
                moved = casters.still
                if known:
                    open = (bits & (wp.uint32(1) << wp.uint32(l))) != wp.uint32(0)
                else:
                    open = not occluded(casters, env, 0, moved, s.alone, s.lift, ray, length)
            free = open
            if open:
                free = not occluded(casters, env, moved, last, s.alone, s.lift, ray, length)
        return open, free

    @wp.func(inline=True)
    def of_delta(
        lights: Lights,
        casters: Casters,
        grid: Grid,
        env: int,
        l: int,
        s: SurfacePoint,
        known: bool,
        hidden: wp.uint32,
        sum: DirectLight,
    ):
        """Gives the sum with what a light without size gives."""
        r = sum
        ray, length, strength = towards(lights, env, l, s.position)
        cosine = wp.dot(s.facing, ray)
        if cosine > 0.0 and wp.dot(s.normal, ray) > 0.0 and strength > 0.0:
            bit = wp.uint32(1) << wp.uint32(l)
            share = (cosine * strength) * lights.colour[env, l]
            open = wp.bool(True)
            free = wp.bool(True)
            if wp.static(f.masked):
                free = (hidden & bit) == wp.uint32(0)
            elif wp.static(f.hard):
                open, free = reaches(lights, casters, grid, env, l, s, ray, length, known, r.bits)
                if wp.static(f.cached):
                    if lights.shadow[l] == 1 and open:
                        r.bits = r.bits | bit
            glint = wp.vec3(0.0, 0.0, 0.0)
            if wp.static(f.gloss):
                if s.alpha >= 0.0:
                    glint = wp.cw_mul(specular(s.alpha, s.f0, s.facing, s.view, ray), share)
            if open:
                r.still_irradiance += share
                if wp.static(f.gloss):
                    r.still_shine += glint
            if free:
                r.irradiance += share
                if wp.static(f.gloss):
                    r.shine += glint
        return r

    return idle, of_delta


@cache
def make_lighting(f: Features) -> Any:
    """Makes the function `gather` with only what a scene has."""
    area = make_area(f.soft, f.trees, f.gloss, f.cached, f.joined) if f.area else None
    idle, of_delta = make_delta(f)

    @wp.func(inline=True)
    def of_area(lights: Lights, casters: Casters, env: int, l: int, s: SurfacePoint, known: bool, sum: DirectLight):
        """Gives the sum with an area light's, unless it is known that still casters hide it."""
        r = sum
        bit = wp.uint32(1) << wp.uint32(l)
        if not known or (r.bits & bit) != wp.uint32(0) or lights.shadow[l] == 0:
            light = area(lights, casters, env, l, s)
            colour = lights.colour[env, l]
            r.irradiance += light.full * colour
            r.still_irradiance += light.still * colour
            if wp.static(f.gloss):
                r.shine += wp.cw_mul(light.full_shine, colour)
                r.still_shine += wp.cw_mul(light.still_shine, colour)
            if light.passes and lights.shadow[l] == 1:
                r.bits = r.bits | bit
        return r

    @wp.func(inline=True)
    def with_light(
        lights: Lights,
        casters: Casters,
        grid: Grid,
        env: int,
        l: int,
        s: SurfacePoint,
        known: bool,
        hidden: wp.uint32,
        sum: DirectLight,
    ):
        """Gives the sum with what light l gives."""
        if wp.static(f.area):
            if lights.kind[l] == AREA:
                return of_area(lights, casters, env, l, s, known, sum)
        if wp.static(f.delta):
            if not idle(lights, env, l, s):
                return of_delta(lights, casters, grid, env, l, s, known, hidden, sum)
        return sum

    @wp.func(inline=True)
    def gather(
        lights: Lights,
        casters: Casters,
        grid: Grid,
        env: int,
        s: SurfacePoint,
        known: bool,
        bits: wp.uint32,
        hidden: wp.uint32,
    ):
        """Gives what all lights give a surface point.

        grid: of the lights that have one, where rays go by grids. known: `bits` tells which lights still casters let
        through. hidden: if masked, a bit for each light that is not seen from here.
        """
        sum = DirectLight()
        sum.bits = bits
        for l in range(lights.kind.shape[0]):
            sum = with_light(lights, casters, grid, env, l, s, known, hidden, sum)
        return sum

    return gather
