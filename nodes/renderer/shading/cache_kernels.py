"""Remembers the radiance of still surfaces under still lights.

The radiance of a still surface without moving casters is remembered, with a bit for each light that then reaches it;
while none of these is hidden by a moving caster, that radiance is the result. Where strengths of lights change, only
the bits are used.
"""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import AREA, Lights, SurfacePoint, make_directions
from nodes.renderer.raster.depth_kernels import MISS
from nodes.renderer.raster.surface_kernels import Face, Pixel
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})


@wp.struct
class ShadingCache:
    """Holds what is remembered of still surfaces [E, H, W]: the triangle that it is of, MISS for none; a bit for each
    light that reaches it; its radiance without moving casters."""

    triangle: wp.array3d(dtype=int)
    lit: wp.array3d(dtype=wp.uint32)
    colour: wp.array3d(dtype=wp.vec3)


@cache
def make_cache(f: Features) -> tuple[Any, Any]:
    """Makes the functions `recall` and `remember`."""
    occluded, crossed = make_occlusion(f.trees, f.joined)
    towards, _ = make_directions(f.directional, f.point, f.spot)

    @wp.func
    def unhidden(lights: Lights, casters: Casters, env: int, bits: wp.uint32, s: SurfacePoint):
        """Tells whether no moving caster hides anything of the lights in `bits`."""
        last = casters.order.shape[0]
        for l in range(lights.kind.shape[0]):
            if ((bits >> wp.uint32(l)) & wp.uint32(1)) != wp.uint32(0):
                if wp.static(f.soft):
                    if lights.kind[l] == AREA:
                        centre = lights.vector[env, l] - s.lift
                        far = wp.length(centre)
                        reach = wp.length(lights.half_u[env, l]) + wp.length(lights.half_v[env, l])
                        ray = centre / far
                        first = casters.still
                        if crossed(casters, env, first, last, s.alone, s.lift, ray, far, reach):
                            return False
                        continue
                if wp.static(f.hard):
                    ray, length, _ = towards(lights, env, l, s.position)
                    if occluded(casters, env, casters.still, last, s.alone, s.lift, ray, length):
                        return False
        return True

    @wp.func
    def recall(lights: Lights, casters: Casters, kept: ShadingCache, pixel: Pixel, t: int, s: SurfacePoint):
        """Tells whether something is known of triangle t in a pixel, the lights that still casters let through to it,
        and whether its remembered radiance is the one that it has."""
        known = wp.bool(False)
        done = wp.bool(False)
        bits = wp.uint32(0)
        if wp.static(f.cached):
            known = kept.triangle[pixel.env, pixel.y, pixel.x] == t
            if known:
                bits = kept.lit[pixel.env, pixel.y, pixel.x]
                if wp.static(not f.flicker):
                    done = True
                    if wp.static(f.shadows):
                        done = unhidden(lights, casters, pixel.env, bits, s)
        return known, bits, done

    @wp.func
    def remember(casters: Casters, kept: ShadingCache, pixel: Pixel, face: Face, bits: wp.uint32, colour: wp.vec3):
        """Keeps what was found out; colour: without moving casters."""
        still = casters.is_still[face.instance] == 1
        kept.triangle[pixel.env, pixel.y, pixel.x] = wp.where(still, face.triangle, MISS)
        kept.lit[pixel.env, pixel.y, pixel.x] = bits
        if wp.static(not f.flicker):
            kept.colour[pixel.env, pixel.y, pixel.x] = colour

    return recall, remember
