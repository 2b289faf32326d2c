"""Direct light on a surface point: directional, point, spot and area lights with their shadows."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.ggx_kernels import specular
from nodes.renderer.lights_shadow_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})

DIRECTIONAL = wp.constant(0)
POINT = wp.constant(1)
SPOT = wp.constant(2)
AREA = wp.constant(3)

FAR = wp.constant(1.0e30)
"""Length [m] of the shadow ray of a directional light."""


@wp.struct
class Lights:
    """kind, shadow, cone [L]; colour [E, L] as it is now; the others [E, L] in the camera frame.

    vector: towards a directional light, or the position. axis: of a spot light. cone: (1 - cos outer angle,
    1 / (cos inner - cos outer)). half_u, half_v: of an area light, which has `side`^2 shadow rays.
    """

    kind: wp.array(dtype=int)
    colour: wp.array2d(dtype=wp.vec3)
    shadow: wp.array(dtype=int)
    cone: wp.array(dtype=wp.vec2)
    vector: wp.array2d(dtype=wp.vec3)
    axis: wp.array2d(dtype=wp.vec3)
    half_u: wp.array2d(dtype=wp.vec3)
    half_v: wp.array2d(dtype=wp.vec3)
    side: int


@wp.struct
class SurfacePoint:
    """Where light arrives. normal is geometric, facing the one to shade with; both towards the viewer.

    lift: start of shadow rays, which leave out instance `alone`. view: towards the viewer. key: of the surface's frozen
    random numbers. alpha < 0: plain diffuse, otherwise GGX with reflectance f0 at normal incidence.
    """

    position: wp.vec3
    lift: wp.vec3
    normal: wp.vec3
    facing: wp.vec3
    alone: int
    view: wp.vec3
    alpha: float
    f0: wp.vec3
    key: wp.uint32


@wp.func
def spot_falloff(lights: Lights, env: int, l: int, ray: wp.vec3):
    """1 inside the inner cone, 0 outside the outer one, between them a smooth step in the cosine.

    1 - cos is half the squared distance of the unit vectors, which keeps its digits in a narrow cone.
    """
    apart = lights.axis[env, l] + ray
    t = wp.clamp((lights.cone[l][0] - 0.5 * wp.dot(apart, apart)) * lights.cone[l][1], 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@wp.func
def out_of_cone(lights: Lights, env: int, l: int, vector: wp.vec3):
    """Whether a point lies outside a spot's cone for certain; vector: from it to the light. Needs no root."""
    edge = 1.0 - lights.cone[l][0] - 1.0e-5
    along = -wp.dot(lights.axis[env, l], vector)
    return edge > 0.0 and (along <= 0.0 or along * along < edge * edge * wp.dot(vector, vector))


@cache
def make_directions(directional: bool, point: bool, spot: bool) -> tuple[Any, Any]:
    """The functions `towards` and `idle` of point-like lights."""
    positional = point or spot
    both = directional and positional

    @wp.func
    def towards(lights: Lights, env: int, l: int, p: wp.vec3):
        """Unit vector to a light, its distance, and its strength: falloff / distance^2, 1 for a directional light."""
        vector = lights.vector[env, l]
        if wp.static(not positional):
            return vector, FAR, 1.0
        if wp.static(both):
            if lights.kind[l] == DIRECTIONAL:
                return vector, FAR, 1.0
        vector = vector - p
        length = wp.length(vector)
        inverse = 1.0 / length
        ray = inverse * vector
        # The square of a far light's distance would overflow.
        strength = inverse * inverse
        if wp.static(spot):
            if lights.kind[l] == SPOT:
                strength *= spot_falloff(lights, env, l, ray)
        return ray, length, strength

    @wp.func
    def idle(lights: Lights, env: int, l: int, s: SurfacePoint):
        """Whether a light is below the surface, or the surface out of its cone: most are, and this is soon known."""
        vector = lights.vector[env, l]
        if wp.static(both):
            if lights.kind[l] != DIRECTIONAL:
                vector = vector - s.position
        elif wp.static(positional):
            vector = vector - s.position
        if wp.dot(s.facing, vector) <= 0.0 or wp.dot(s.normal, vector) <= 0.0:
            return True
        if wp.static(spot):
            if lights.kind[l] == SPOT:
                return out_of_cone(lights, env, l, vector)
        return False

    return towards, idle


def make_lighting(
    kinds: tuple[bool, bool, bool],
    area: Any,
    hard: bool,
    soft: bool,
    trees: bool,
    joined: bool,
    cache: bool,
    gloss: bool,
    masked: bool = False,
) -> tuple[Any, Any]:
    """The functions `unhidden` and `gather` with only what a scene has; area: the function of area lights, or None.

    kinds: whether there are directional, point and spot lights; hard: whether one of these has shadows; soft: whether
    an area light has. masked: rays to the other lights have been traced, see shadow_kernels.
    """
    delta = any(kinds)
    occluded, crossed = make_occlusion(trees, joined)
    towards, idle = make_directions(*kinds)

    @wp.func
    def unhidden(
        lights: Lights,
        casters: Casters,
        env: int,
        bits: wp.uint32,
        s: SurfacePoint,
    ):
        """Whether no moving caster hides anything of the lights in `bits`."""
        last = casters.order.shape[0]
        for l in range(lights.kind.shape[0]):
            if ((bits >> wp.uint32(l)) & wp.uint32(1)) != wp.uint32(0):
                if wp.static(soft):
                    if lights.kind[l] == AREA:
                        centre = lights.vector[env, l] - s.lift
                        far = wp.length(centre)
                        reach = wp.length(lights.half_u[env, l]) + wp.length(lights.half_v[env, l])
                        ray = centre / far
                        first = casters.still
                        if crossed(casters, env, first, last, s.alone, s.lift, ray, far, reach):
                            return False
                        continue
                if wp.static(hard):
                    ray, length, _ = towards(lights, env, l, s.position)
                    if occluded(casters, env, casters.still, last, s.alone, s.lift, ray, length):
                        return False
        return True

    @wp.func
    def gather(
        lights: Lights,
        casters: Casters,
        env: int,
        s: SurfacePoint,
        moved: int,
        last: int,
        known: bool,
        bits: wp.uint32,
        hidden: wp.uint32,
    ):
        """Irradiance for the diffuse term and radiance of the specular one, each also without moving casters.

        Then a bit for each light that still casters let through; if `known`, those are given. hidden: if masked, a bit
        for each light that is not seen from here.
        """
        irradiance = wp.vec3(0.0, 0.0, 0.0)
        unblocked = wp.vec3(0.0, 0.0, 0.0)
        shine = wp.vec3(0.0, 0.0, 0.0)
        shine_unblocked = wp.vec3(0.0, 0.0, 0.0)
        for l in range(lights.kind.shape[0]):
            bit = wp.uint32(1) << wp.uint32(l)
            if wp.static(area is not None):
                if lights.kind[l] == AREA:
                    if not known or (bits & bit) != wp.uint32(0) or lights.shadow[l] == 0:
                        passes, full, still, full_shine, still_shine = area(lights, casters, env, l, s, moved, last)
                        colour = lights.colour[env, l]
                        irradiance += full * colour
                        unblocked += still * colour
                        if wp.static(gloss):
                            shine += wp.cw_mul(full_shine, colour)
                            shine_unblocked += wp.cw_mul(still_shine, colour)
                        if passes and lights.shadow[l] == 1:
                            bits = bits | bit
                    continue
            if wp.static(delta):
                if idle(lights, env, l, s):
                    continue
                ray, length, strength = towards(lights, env, l, s.position)
                cosine = wp.dot(s.facing, ray)
                if cosine > 0.0 and wp.dot(s.normal, ray) > 0.0 and strength > 0.0:
                    share = (cosine * strength) * lights.colour[env, l]
                    open = wp.bool(True)
                    free = wp.bool(True)
                    if wp.static(masked):
                        free = (hidden & bit) == wp.uint32(0)
                    elif wp.static(hard):
                        if lights.shadow[l] == 1:
                            if wp.static(cache):
                                if known:
                                    open = (bits & bit) != wp.uint32(0)
                                else:
                                    open = not occluded(casters, env, 0, moved, s.alone, s.lift, ray, length)
                                    bits = wp.where(open, bits | bit, bits)
                            free = open
                            if open:
                                free = not occluded(casters, env, moved, last, s.alone, s.lift, ray, length)
                    glint = wp.vec3(0.0, 0.0, 0.0)
                    if wp.static(gloss):
                        if s.alpha >= 0.0:
                            glint = wp.cw_mul(specular(s.alpha, s.f0, s.facing, s.view, ray), share)
                    if open:
                        unblocked += share
                        if wp.static(gloss):
                            shine_unblocked += glint
                    if free:
                        irradiance += share
                        if wp.static(gloss):
                            shine += glint
        return irradiance, unblocked, shine, shine_unblocked, bits

    return unhidden, gather
