"""Remembers the radiance of still surfaces under still lights.

The radiance of a still surface without moving casters is remembered, with a bit for each light that then reaches it;
while none of these is hidden by a moving caster, that radiance is the result. Where strengths of lights change, only
the bits, `lit_mask`, are used.
"""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.area_kernels import make_hull_test
from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import AREA, Lights, make_light_directions
from nodes.renderer.lights.surface_point_kernels import SurfacePoint
from nodes.renderer.raster.depth_kernels import MISS
from nodes.renderer.raster.surface_kernels import Pixel, SurfaceHit
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})


@wp.struct
class ShadingCache:
    """Holds what is remembered of still surfaces [E, H, W]: the triangle that it is of, MISS for none; a bit for each
    light that still casters let through to it; its radiance without moving casters."""

    triangle: wp.array3d(dtype=int)
    lit_mask: wp.array3d(dtype=wp.uint32)
    radiance: wp.array3d(dtype=wp.vec3)


@cache
def make_cache(f: Features) -> tuple[Any, Any]:
    """Makes the functions `recall` and `remember`."""
    occluded, _ = make_occlusion(f.trees, f.merged)
    may_shade_area = make_hull_test(f.trees, f.merged)
    light_direction, _ = make_light_directions(f.directional, f.point, f.spot)

    @wp.func
    def all_visible(lights: Lights, casters: Casters, env: int, lit_mask: wp.uint32, s: SurfacePoint):
        """Tells whether no moving caster hides anything of the lights in `lit_mask`."""
        last = casters.order.shape[0]
        for l in range(lights.kind.shape[0]):
            if ((lit_mask >> wp.uint32(l)) & wp.uint32(1)) != wp.uint32(0):
                if wp.static(f.soft):
                    if lights.kind[l] == AREA:
                        if may_shade_area(lights, casters, env, l, s, casters.still, last):
                            return False
                        continue
                if wp.static(f.hard):
                    ray, length, _ = light_direction(lights, env, l, s.position)
                    if occluded(casters, env, casters.still, last, s.skip_instance, s.ray_origin, ray, length):
                        return False
        return True

    @wp.func
    def recall(lights: Lights, casters: Casters, shading_cache: ShadingCache, pixel: Pixel, t: int, s: SurfacePoint):
        """Tells whether something is cached of triangle t in a pixel, the lights that still casters let through to it,
        and whether its remembered radiance is the one that it has."""
        cached = wp.bool(False)
        valid = wp.bool(False)
        lit_mask = wp.uint32(0)
        if wp.static(f.cached):
            cached = shading_cache.triangle[pixel.env, pixel.y, pixel.x] == t
            if cached:
                lit_mask = shading_cache.lit_mask[pixel.env, pixel.y, pixel.x]
                if wp.static(not f.flicker):
                    valid = True
                    if wp.static(f.shadows):
                        valid = all_visible(lights, casters, pixel.env, lit_mask, s)
        return cached, lit_mask, valid

    @wp.func
    def remember(
        casters: Casters,
        shading_cache: ShadingCache,
        pixel: Pixel,
        hit: SurfaceHit,
        lit_mask: wp.uint32,
        radiance: wp.vec3,
    ):
        """Remembers the light of a pixel's still surface; radiance: without moving casters."""
        still = casters.is_still[hit.instance] == 1
        shading_cache.triangle[pixel.env, pixel.y, pixel.x] = wp.where(still, hit.triangle, MISS)
        shading_cache.lit_mask[pixel.env, pixel.y, pixel.x] = lit_mask
        if wp.static(not f.flicker):
            shading_cache.radiance[pixel.env, pixel.y, pixel.x] = radiance

    return recall, remember
