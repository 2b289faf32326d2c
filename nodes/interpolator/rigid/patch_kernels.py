"""Finds the patch of a z-buffer entry: a piece of surface, seen from one side."""

import warp as wp

from nodes.renderer.raster.depth_kernels import back_of

wp.set_module_options({"enable_backward": False})


@wp.func
def patch_of(hit: wp.uint64, piece: wp.vec2i):
    """Gives the patch that a pixel shows; piece: body and front's patch of its triangle, whose back's is the next."""
    return piece[1] + back_of(hit)
