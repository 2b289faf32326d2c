"""Computes the light that falls straight from lamps and sky on a surface point: in closed form with nothing in the way
(Lambert's cosine, distance, cone), and whether anything may be in its way, by the casters' boxes."""

from functools import cache
from typing import Any

import warp as wp

from evis.media.colour import REC709
from nodes.interpolator.relight.boxes_kernels import any_box_may_hide
from nodes.interpolator.relight.change_kernels import Change, Point
from nodes.interpolator.relight.features import LightChanges
from nodes.renderer.lights.light_kernels import AREA, Lights, make_light_directions
from nodes.renderer.lights.sky_kernels import make_sky
from nodes.renderer.shadows.ray_kernels import Casters

wp.set_module_options({"enable_backward": False})

MANY = wp.constant(16)
"""Casters from which on a shadow ray costs less than asking all their boxes."""
BRIGHTNESS = wp.constant(wp.vec3(*REC709))
"""Weights of luminance."""
DARKEST = wp.constant(1.0e-30)
"""Irradiance below which the logarithm is that of this one."""


@cache
def make_irradiance(f: LightChanges) -> tuple[Any, Any]:
    """Makes the functions `log_irradiance` and `log_irradiance_then`."""
    light_direction, _ = make_light_directions(f.directional, f.point or f.area, f.spot)
    _, ambient, _ = make_sky(f.mapped)

    @wp.func
    def irradiance(change: Change, lights: Lights, row: int, sky_row: int, s: Point, up: wp.vec3):
        """Computes the irradiance of a point, as luminance, with nothing in the way. up: its normal in the camera
        frame of sky_row."""
        e = wp.pi * wp.dot(BRIGHTNESS, ambient(change.sky, sky_row, up))
        for l in range(lights.kind.shape[0]):
            ray, _length, strength = light_direction(lights, row, l, s.position)
            cosine = wp.dot(s.normal, ray)
            if cosine > 0.0:
                share = cosine * strength * change.weight[l]
                if wp.static(f.area):
                    if lights.kind[l] == AREA:
                        facing = wp.dot(wp.cross(lights.half_u[row, l], lights.half_v[row, l]), ray)
                        share *= 4.0 * wp.abs(facing)
                e += share
        return e

    @wp.func
    def log_irradiance(change: Change, row: int, s: Point):
        """Computes ln of the irradiance of a point in the row of a slot."""
        return wp.log(wp.max(irradiance(change, change.now, row, row, s, s.normal), DARKEST))

    @wp.func
    def log_irradiance_then(change: Change, row: int, row_then: int, then: Point):
        """Computes ln of the irradiance of a point at a keyframe, which has row_then; row: of any slot."""
        up = wp.transpose(change.casters.turn[row]) * (change.eye_then[row_then] * then.normal)
        return wp.log(wp.max(irradiance(change, change.then, row_then, row, then, up), DARKEST))

    return log_irradiance, log_irradiance_then


@cache
def make_shaded(f: LightChanges) -> Any:
    """Makes the function `shaded`."""
    light_direction, _ = make_light_directions(f.directional, f.point or f.area, f.spot)

    @wp.func
    def shaded(change: Change, lights: Lights, casters: Casters, row: int, s: Point, first: int, around: float):
        """Tells whether casters from order[first] on may be between a light and what it shines on within a distance
        `around` of a point [m]."""
        for l in range(lights.kind.shape[0]):
            if lights.shadow[l] == 1:
                ray, length, strength = light_direction(lights, row, l, s.position)
                wide = float(0.0)
                if wp.static(f.area):
                    if lights.kind[l] == AREA:
                        wide = wp.length(lights.half_u[row, l]) + wp.length(lights.half_v[row, l])
                if wp.dot(s.normal, ray) * length > -wide and strength > 0.0:
                    if casters.order.shape[0] - first > MANY:
                        return True
                    if any_box_may_hide(
                        casters, change.half, row, first, s.skip, s.position, ray, length, wide, around
                    ):
                        return True
        return False

    return shaded
