"""Sums what all lights give a surface point."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.area_kernels import make_area_light
from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import AREA, DirectLight, Lights, make_light_directions
from nodes.renderer.lights.surface_point_kernels import SurfacePoint
from nodes.renderer.materials.ggx_kernels import specular
from nodes.renderer.shadows.grid_kernels import Grid, hidden_from
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})


@cache
def make_delta_lights(f: Features) -> tuple[Any, Any]:
    """Makes the functions `cannot_reach` and `add_delta_light` of lights without size."""
    occluded, _ = make_occlusion(f.trees, f.merged)
    light_direction, cannot_reach = make_light_directions(f.directional, f.point, f.spot)

    @wp.func(inline=True)
    def light_visibility(
        lights: Lights,
        casters: Casters,
        grid: Grid,
        env: int,
        l: int,
        s: SurfacePoint,
        ray: wp.vec3,
        length: float,
        cached: bool,
        lit_mask: wp.uint32,
    ):
        """Tells whether still casters let a light without size through, and whether all do."""
        moved = wp.int32(0)
        last = casters.order.shape[0]
        still_visible = wp.bool(True)
        visible = wp.bool(True)
        if lights.shadow[l] == 1:
            if wp.static(f.grids):
                if grid.of[l] >= 0:
                    visible = not hidden_from(
                        casters, grid, grid.of[l], env, s.skip_instance, s.ray_origin, ray, length
                    )
                    return visible, visible
            if wp.static(f.cached):
                moved = casters.still
                if cached:
                    still_visible = (lit_mask & (wp.uint32(1) << wp.uint32(l))) != wp.uint32(0)
                else:
                    still_visible = not occluded(casters, env, 0, moved, s.skip_instance, s.ray_origin, ray, length)
            visible = still_visible
            if still_visible:
                visible = not occluded(casters, env, moved, last, s.skip_instance, s.ray_origin, ray, length)
        return still_visible, visible

    @wp.func(inline=True)
    def add_delta_light(
        lights: Lights,
        casters: Casters,
        grid: Grid,
        env: int,
        l: int,
        s: SurfacePoint,
        cached: bool,
        shadow_mask: wp.uint32,
        sum: DirectLight,
    ):
        """Gives the sum with what a light without size gives."""
        r = sum
        ray, length, strength = light_direction(lights, env, l, s.position)
        cosine = wp.dot(s.shading_normal, ray)
        if cosine > 0.0 and wp.dot(s.normal, ray) > 0.0 and strength > 0.0:
            bit = wp.uint32(1) << wp.uint32(l)
            share = (cosine * strength) * lights.colour[env, l]
            still_visible = wp.bool(True)
            visible = wp.bool(True)
            if wp.static(f.shadow_pass):
                visible = (shadow_mask & bit) == wp.uint32(0)
            elif wp.static(f.hard):
                still_visible, visible = light_visibility(
                    lights, casters, grid, env, l, s, ray, length, cached, r.lit_mask
                )
                if wp.static(f.cached):
                    if lights.shadow[l] == 1 and still_visible:
                        r.lit_mask = r.lit_mask | bit
            specular_term = wp.vec3(0.0, 0.0, 0.0)
            if wp.static(f.gloss):
                if s.alpha >= 0.0:
                    specular_term = wp.cw_mul(specular(s.alpha, s.f0, s.shading_normal, s.view, ray), share)
            if still_visible:
                r.still_irradiance += share
                if wp.static(f.gloss):
                    r.still_specular += specular_term
            if visible:
                r.irradiance += share
                if wp.static(f.gloss):
                    r.specular += specular_term
        return r

    return cannot_reach, add_delta_light


@cache
def make_direct_light(f: Features) -> Any:
    """Makes the function `direct_light` with only what a scene has."""
    area_light = make_area_light(f.soft, f.trees, f.gloss, f.cached, f.merged) if f.area else None
    cannot_reach, add_delta_light = make_delta_lights(f)

    @wp.func(inline=True)
    def add_area_light(
        lights: Lights, casters: Casters, env: int, l: int, s: SurfacePoint, cached: bool, sum: DirectLight
    ):
        """Gives the sum with an area light's, unless it is known that still casters hide it."""
        r = sum
        bit = wp.uint32(1) << wp.uint32(l)
        if not cached or (r.lit_mask & bit) != wp.uint32(0) or lights.shadow[l] == 0:
            light = area_light(lights, casters, env, l, s)
            colour = lights.colour[env, l]
            r.irradiance += light.irradiance * colour
            r.still_irradiance += light.still_irradiance * colour
            if wp.static(f.gloss):
                r.specular += wp.cw_mul(light.specular, colour)
                r.still_specular += wp.cw_mul(light.still_specular, colour)
            if light.still_lit and lights.shadow[l] == 1:
                r.lit_mask = r.lit_mask | bit
        return r

    @wp.func(inline=True)
    def add_light(
        lights: Lights,
        casters: Casters,
        grid: Grid,
        env: int,
        l: int,
        s: SurfacePoint,
        cached: bool,
        shadow_mask: wp.uint32,
        sum: DirectLight,
    ):
        """Gives the sum with what light l gives."""
        if wp.static(f.area):
            if lights.kind[l] == AREA:
                return add_area_light(lights, casters, env, l, s, cached, sum)
        if wp.static(f.delta):
            if not cannot_reach(lights, env, l, s):
                return add_delta_light(lights, casters, grid, env, l, s, cached, shadow_mask, sum)
        return sum

    @wp.func(inline=True)
    def direct_light(
        lights: Lights,
        casters: Casters,
        grid: Grid,
        env: int,
        s: SurfacePoint,
        cached: bool,
        lit_mask: wp.uint32,
        shadow_mask: wp.uint32,
    ):
        """Gives what all lights give a surface point.

        grid: of the lights that have one, where rays go by grids. cached: `lit_mask` tells which lights still casters
        let through. shadow_mask: after a shadow pass, a bit for each light that is hidden from here.
        """
        sum = DirectLight()
        sum.lit_mask = lit_mask
        for l in range(lights.kind.shape[0]):
            sum = add_light(lights, casters, grid, env, l, s, cached, shadow_mask, sum)
        return sum

    return direct_light
