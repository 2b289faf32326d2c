"""Describes the point of a surface at which light arrives, for direct light and for paths."""

import warp as wp

from nodes.renderer.raster.surface_kernels import SurfaceHit
from nodes.renderer.shadows.ray_kernels import Casters, shadow_start

wp.set_module_options({"enable_backward": False})


@wp.struct
class SurfacePoint:
    """Holds where light arrives, in the camera frame. normal is geometric, shading_normal that of the material's lobe;
    both towards the viewer, as `view` is.

    ray_origin: start of rays from here, which leave out instance `skip_instance`. alpha < 0: plain diffuse, otherwise
    GGX with reflectance f0 at normal incidence. key: of the surface's frozen random numbers.
    """

    position: wp.vec3
    ray_origin: wp.vec3
    normal: wp.vec3
    shading_normal: wp.vec3
    skip_instance: int
    view: wp.vec3
    alpha: float
    f0: wp.vec3
    key: wp.uint32


@wp.func
def with_ray_origin(casters: Casters, point: SurfacePoint, hit: SurfaceHit):
    """Gives the point of a hit with where its rays start and whom they leave out."""
    s = point
    ray_origin, skip_instance = shadow_start(casters, hit.instance, s.position, s.normal, hit.side > 0.0)
    s.ray_origin = ray_origin
    s.skip_instance = skip_instance
    return s
