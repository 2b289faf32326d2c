"""Computes the z-buffer entries of listed pixels at instants, by rays."""

import warp as wp

from nodes.interpolator.refine.evaluation.visibility_kernels import make_trace_between
from nodes.interpolator.refine.samples.list_kernels import ListPart, end_of
from nodes.interpolator.refine.window_kernels import FEW_REGISTERS, WindowParameters, WindowScene
from nodes.renderer.raster.depth_kernels import NO_ENTRY
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})

trace_between = make_trace_between(False)
"""Without trees: that the few rays that meet nothing they should would be faster costs all others more."""


@wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
def trace_pixels(
    # in
    view: CameraView,
    params: WindowParameters,
    workers: int,
    scene: WindowScene,
    listed: ListPart,
    at: wp.array(dtype=int),
    before: wp.array(dtype=wp.uint64),
    after: wp.array(dtype=wp.uint64),
    # out
    hits: wp.array(dtype=wp.uint64),
):
    """Computes z-buffer entries of the pixels of a part of a list; at, before, after: of Requests or of Intervals.

    NO_ENTRY, of what needs none, stays.
    """
    j = listed.start + wp.tid()
    while j < end_of(listed):
        x = at[j] % params.width + params.margin
        y = at[j] // params.width % params.height + params.margin
        n = at[j] // (params.width * params.height)
        if before[j] == NO_ENTRY:
            hits[j] = NO_ENTRY
        else:
            hits[j] = trace_between(view, scene.targets, n, pixel_ray(view, x, y), before[j], after[j], False)
        j += workers
