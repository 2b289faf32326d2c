"""Computes how a surface point sees a rectangular area light, and its irradiance in closed form."""

import warp as wp

from nodes.renderer.lights.light_kernels import Lights
from nodes.renderer.lights.surface_point_kernels import SurfacePoint

wp.set_module_options({"enable_backward": False})

SMALL = wp.constant(2.0e-3)
"""Radius of an area light, of its distance, below which the closed form has cancelled and a point is as exact."""


@wp.struct
class Rectangle:
    """Holds an area light as a surface point sees it: its middle from there, half-edges, and the normal of the side
    that emits; flux: irradiance for radiance 1 with nothing in the way, 0 where it lies behind or below."""

    centre: wp.vec3
    u: wp.vec3
    v: wp.vec3
    normal: wp.vec3
    area: float
    flux: float


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
    normal = wp.normalize(cross)
    if wp.dot(centre, normal) < 0.0:
        r.flux = rectangle_irradiance(centre, u, v, s.shading_normal)
    r.centre = centre
    r.u = u
    r.v = v
    r.normal = normal
    r.area = 4.0 * wp.length(cross)
    return r


@wp.func
def wholly_above(r: Rectangle, normal: wp.vec3):
    """Tells whether no part of a rectangle lies below the surface."""
    return wp.dot(r.centre, normal) >= wp.abs(wp.dot(r.u, normal)) + wp.abs(wp.dot(r.v, normal))
