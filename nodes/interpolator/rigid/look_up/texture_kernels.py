"""Evaluates textures at the keyframes and in between, so that those which are finer than pixels need not be
interpolated."""

from functools import cache
from typing import Any

import warp as wp

from evis.media.colour import REC709
from nodes.interpolator.rigid.look_up.look_up_kernels import NO_ALBEDO
from nodes.renderer.raster.depth_kernels import MISS, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import (
    Pixel,
    Surfaces,
    VisibilityBuffer,
    hit_of_entry,
    make_surface,
    pixel_at,
)

wp.set_module_options({"enable_backward": False})

WEIGHTS = wp.constant(wp.vec3(*REC709))
DIM = wp.constant(0.02)
"""Albedo from which on light that is reflected without it counts for little."""


@cache
def make_log_albedo(textures: bool, smooth: bool, vertex_colours: bool) -> Any:
    """Makes the function `log_albedo`."""
    surface = make_surface(textures, smooth, vertex_colours)

    @wp.func
    def log_albedo(view: CameraView, pixel: Pixel, entry: wp.uint64, seen: VisibilityBuffer, surfaces: Surfaces):
        """Computes ln of the luminance of the albedo that a pixel shows; 0 of what is not textured, glows or is dim.

        entry: of the z-buffer, which need not stand in `seen`.
        """
        if triangle_of(entry) == MISS:
            return 0.0
        hit = hit_of_entry(view, seen, surfaces, pixel, entry)
        if surfaces.textures.place[hit.instance][1] == 0:
            return 0.0
        if wp.max(surfaces.emission[surfaces.material[hit.instance]]) > 0.0:
            return 0.0
        albedo, _facing = surface(view, pixel, seen, surfaces, hit)
        bright = wp.dot(WEIGHTS, albedo)
        if bright < DIM:
            return 0.0
        return wp.log(bright)

    return log_albedo


@cache
def make_demodulate(textures: bool, smooth: bool, vertex_colours: bool) -> wp.Kernel:
    """Makes the kernel `demodulate`."""
    log_albedo = make_log_albedo(textures, smooth, vertex_colours)

    @wp.kernel(module="unique", enable_backward=False)
    def demodulate(
        # in
        view: CameraView,
        row0: int,
        span: int,
        seen: VisibilityBuffer,
        surfaces: Surfaces,
        logs: wp.array3d(dtype=float),
        # out
        demodulated: wp.array3d(dtype=float),
    ):
        """Computes ln of the light alone of the pixels [E, H, W] of the first slot, from row0 on, or NO_ALBEDO; logs:
        ln I."""
        env, row, part = wp.tid()
        y = row0 + row
        for x in range(part * span, wp.min(part * span + span, view.width)):
            texture = log_albedo(view, pixel_at(env, y, x), seen.packed[env, y, x], seen, surfaces)
            demodulated[env, y, x] = wp.where(texture == 0.0, NO_ALBEDO, logs[env, y, x] - texture)

    return demodulate
