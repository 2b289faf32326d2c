"""Describes lights, and the ray to one without size from a point of a surface."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.reading_kernels import vector_at
from nodes.renderer.lights.surface_point_kernels import SurfacePoint

wp.set_module_options({"enable_backward": False})

DIRECTIONAL = wp.constant(0)
POINT = wp.constant(1)
SPOT = wp.constant(2)
AREA = wp.constant(3)

FAR = wp.constant(1.0e30)
"""Length [m] of the shadow ray of a directional light."""


@wp.struct
class Lights:
    """Holds kind, shadow, cone [L]; colour [E, L] as it is now; the others [E, L] in the camera frame.

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
class DirectLight:
    """Holds what lights give a surface point: irradiance for the diffuse term and reflected radiance of the specular
    one.

    still_irradiance, still_specular: without moving casters. lit_mask: a bit for each light that still casters let
    through.
    """

    irradiance: wp.vec3
    specular: wp.vec3
    still_irradiance: wp.vec3
    still_specular: wp.vec3
    lit_mask: wp.uint32


@wp.func
def vector_of(lights: Lights, env: int, l: int):
    """Gives the unit vector towards a directional light, or where another one is [m]."""
    return vector_at(lights.vector, env * lights.kind.shape[0] + l)


@wp.func
def axis_of(lights: Lights, env: int, l: int):
    """Gives the axis of a spot light."""
    return vector_at(lights.axis, env * lights.kind.shape[0] + l)


@wp.func
def spot_falloff(lights: Lights, env: int, l: int, ray: wp.vec3):
    """Gives 1 inside the inner cone, 0 outside the outer one, between them a smooth step in the cosine.

    1 - cos is half the squared distance of the unit vectors, which keeps its digits in a narrow cone.
    """
    apart = axis_of(lights, env, l) + ray
    t = wp.clamp((lights.cone[l][0] - 0.5 * wp.dot(apart, apart)) * lights.cone[l][1], 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@wp.func
def out_of_cone(lights: Lights, env: int, l: int, vector: wp.vec3):
    """Tells whether a point lies outside a spot's cone for certain; vector: from it to the light. Needs no root."""
    edge = 1.0 - lights.cone[l][0] - 1.0e-5
    along = -wp.dot(axis_of(lights, env, l), vector)
    return edge > 0.0 and (along <= 0.0 or along * along < edge * edge * wp.dot(vector, vector))


@cache
def make_light_directions(directional: bool, point: bool, spot: bool) -> tuple[Any, Any]:
    """Makes the functions `light_direction` and `cannot_reach` of point-like lights."""
    positional = point or spot
    both = directional and positional

    @wp.func
    def light_direction(lights: Lights, env: int, l: int, p: wp.vec3):
        """Gives the unit vector to a light, its distance, and its strength: falloff / distance^2, 1 for a directional
        light."""
        vector = vector_of(lights, env, l)
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
    def cannot_reach(lights: Lights, env: int, l: int, s: SurfacePoint):
        """Tells whether a light is below the surface, or the surface out of its cone: true of most, and soon found."""
        vector = vector_of(lights, env, l)
        if wp.static(both):
            if lights.kind[l] != DIRECTIONAL:
                vector = vector - s.position
        elif wp.static(positional):
            vector = vector - s.position
        if wp.dot(s.shading_normal, vector) <= 0.0 or wp.dot(s.normal, vector) <= 0.0:
            return True
        if wp.static(spot):
            if lights.kind[l] == SPOT:
                return out_of_cone(lights, env, l, vector)
        return False

    return light_direction, cannot_reach
