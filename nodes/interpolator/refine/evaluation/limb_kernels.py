"""Computes the radiance of listed points of outlines, where what is round has another light than a pixel beside."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.samples.list_kernels import ListPart, end_of
from nodes.interpolator.refine.samples.request_kernels import LIMB, make_requests
from nodes.interpolator.refine.window_kernels import WindowParameters
from nodes.interpolator.rigid.look_up.log_kernels import fused_luminance
from nodes.renderer.lights.features import Features
from nodes.renderer.lights.light_kernels import Lights
from nodes.renderer.lights.sky_kernels import Sky
from nodes.renderer.raster.depth_kernels import back_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import Surfaces, VisibilityBuffer, pixel_at
from nodes.renderer.shading.point_kernels import make_shade_point
from nodes.renderer.shading.radiance_kernels import finite
from nodes.renderer.shadows.grid_kernels import Grid
from nodes.renderer.shadows.ray_kernels import Casters

wp.set_module_options({"enable_backward": False})

LARGEST = wp.constant(3.0e38)
"""The largest radiance."""


@cache
def make_shade_limbs(channels: int, features: Features) -> wp.Kernel:
    """Makes the kernel `shade_limbs`; channels: 1 (luminance) or 3 (RGB). features: of the light in the scene."""
    pixel = pixel_type(channels)
    Requests: Any = make_requests(channels)
    shade_point = make_shade_point(features)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": features.fast_math})
    def shade_limbs(
        # in
        view: CameraView,
        params: WindowParameters,
        workers: int,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        grid: Grid,
        requests: Requests,
        listed: ListPart,
        # out
        values: wp.array(dtype=pixel),
    ):
        """Computes the radiance of those of a part of the list that are points of outlines."""
        j = listed.start + wp.tid()
        while j < end_of(listed):
            if requests.shown[j] == LIMB:
                at = requests.at[j]
                x = at % params.width + params.margin
                y = at // params.width % params.height + params.margin
                shown = pixel_at(at // (params.width * params.height), y, x)
                face = requests.after[j]
                side = 1.0 - 2.0 * float(back_of(face))
                colour = shade_point(
                    view,
                    shown,
                    seen,
                    surfaces,
                    lights,
                    sky,
                    casters,
                    grid,
                    triangle_of(face),
                    side,
                    requests.weights[j],
                )
                colour = wp.vec3(finite(colour[0], LARGEST), finite(colour[1], LARGEST), finite(colour[2], LARGEST))
                if wp.static(channels == 1):
                    values[j] = fused_luminance(colour)
                else:
                    values[j] = colour
            j += workers

    return shade_limbs
