"""Computes the z-buffer entries of listed pixels at instants, by rays."""

import warp as wp

from nodes.interpolator.refine.evaluation.visibility_kernels import make_trace_between
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
    band: int,
    most: int,
    count: wp.array(dtype=int),
    scene: WindowScene,
    at: wp.array(dtype=int),
    before: wp.array(dtype=wp.uint64),
    after: wp.array(dtype=wp.uint64),
    # out
    hits: wp.array(dtype=wp.uint64),
):
    """Computes z-buffer entries of the listed pixels of a band; at, before, after: of Requests or of Intervals.

    NO_ENTRY, of what needs none, stays. A band's part of a list begins at band * most, and has count[band] entries, of
    which the first `most` are there.
    """
    first = band * most
    last = first + wp.min(count[band], most)
    j = first + wp.tid()
    while j < last:
        x = at[j] % params.width + params.margin
        y = at[j] // params.width % params.height + params.margin
        n = at[j] // (params.width * params.height)
        if before[j] == NO_ENTRY:
            hits[j] = NO_ENTRY
        else:
            hits[j] = trace_between(view, scene.targets, n, pixel_ray(view, x, y), before[j], after[j], False)
        j += workers
