"""Samples an area light and the specular lobe, with random numbers that are frozen on the surface."""

import warp as wp

from nodes.renderer.lights.rectangle_kernels import Rectangle
from nodes.renderer.lights.surface_point_kernels import SurfacePoint
from nodes.renderer.materials.ggx_kernels import sample_density, sample_direction, specular

wp.set_module_options({"enable_backward": False})

LATTICE = wp.constant(
    wp.mat33(0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6),
)
"""Rotation of the lattice of the random numbers, so that no face of a box lies along its cells' borders."""


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
    hits_light: bool


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
def light_area_sample(r: Rectangle, s: SurfacePoint, a: float, b: float):
    """Gives the sample towards the point (a, b) in [0, 1)^2 of a rectangle."""
    sample = AreaSample()
    towards = r.centre + (2.0 * a - 1.0) * r.u + (2.0 * b - 1.0) * r.v
    length = wp.length(towards)
    ray = towards / length
    cosine = wp.dot(s.shading_normal, ray)
    leaving = -wp.dot(r.normal, ray)
    if cosine > 0.0 and leaving > 0.0:
        sample.weight = cosine * leaving / length / length
        sample.density = length * length / (leaving * r.area)
        sample.hits_light = wp.dot(s.normal, ray) > 0.0
    sample.towards = towards
    sample.ray = ray
    sample.cosine = cosine
    return sample


@wp.func
def lobe_sample(r: Rectangle, s: SurfacePoint, a: float, b: float):
    """Gives the sample of the specular lobe for (a, b) in [0, 1)^2."""
    sample = AreaSample()
    ray = sample_direction(s.alpha, s.shading_normal, s.view, wp.vec2(a, b))
    cosine = wp.dot(s.shading_normal, ray)
    normal = r.normal
    leaving = -wp.dot(normal, ray)
    if cosine > 0.0 and leaving > 0.0:
        centre = r.centre
        u = r.u
        v = r.v
        length = -wp.dot(centre, normal) / leaving
        towards = length * ray
        place = towards - centre
        within = wp.abs(wp.dot(place, u)) <= wp.dot(u, u) and wp.abs(wp.dot(place, v)) <= wp.dot(v, v)
        sample.hits_light = within and wp.dot(s.normal, ray) > 0.0
        sample.density = length * length / (leaving * r.area)
        sample.towards = towards
    sample.ray = ray
    sample.cosine = cosine
    return sample


@wp.func
def specular_estimate(s: SurfacePoint, sample: AreaSample, count: float):
    """Gives the specular radiance by one of `count` samples of a light of radiance 1, taken of the light or of the
    lobe.

    The sum of both densities is the balance heuristic's.
    """
    brdf = specular(s.alpha, s.f0, s.shading_normal, s.view, sample.ray)
    other = sample_density(s.alpha, s.shading_normal, s.view, sample.ray)
    return (sample.cosine / (count * (sample.density + other))) * brdf
