"""Finds how narrow boxes are along their way through the image, and over how many pixels they go unseen."""

import warp as wp

from nodes.interpolator.refine.probing.box_kernels import reach

wp.set_module_options({"enable_backward": False})

NARROW = wp.constant(1.0)
"""Width [px] of a thing along its way below which it may be on no pixel of an image that it is in."""


@wp.struct
class NarrowWay:
    """Holds how narrow a box is along its way from one instant to the next [px], infinite where it does not move in the
    image, for how many instants it is on a pixel, and how many pixels it goes over."""

    width: wp.float64
    stay: wp.float64
    pixels: wp.float64


@wp.func
def narrow_way(
    centre: wp.vec3d, axes: wp.mat33d, half: wp.vec3d, last_centre: wp.vec3d, sides: wp.vec4d, scale: wp.float64
):
    """Measures the way of a box through the image between two instants; sides, scale: as of follow_boxes."""
    zero = wp.float64(0.0)
    way = NarrowWay()
    step = wp.vec2d(
        scale * (centre[0] / centre[2] - last_centre[0] / last_centre[2]),
        scale * (centre[1] / centre[2] - last_centre[1] / last_centre[2]),
    )
    gone = wp.length(step)
    way.width = wp.float64(wp.inf)
    if gone > zero:
        along = step / gone
        # Of a side of the box what counts is how far it reaches in the image, where it is ahead.
        slope = wp.vec2d(centre[0] / centre[2], centre[1] / centre[2])
        forward = wp.vec3d(along[0], along[1], -(along[0] * slope[0] + along[1] * slope[1]))
        across = wp.vec3d(-along[1], along[0], along[1] * slope[0] - along[0] * slope[1])
        size = wp.float64(2.0) * scale / centre[2]
        way.width = size * reach(forward, wp.vec3d(), axes, half)
        way.stay = way.width / gone
        image = scale * wp.max(sides[1] - sides[0], sides[3] - sides[2])
        way.pixels = gone * wp.min(size * reach(across, wp.vec3d(), axes, half), image)
    return way


@wp.func
def add_missed(way: NarrowWay, spacing: wp.float64, env: int, missed: wp.array2d(dtype=wp.float64)):
    """Adds the pixels that a box goes over unseen from one instant to the next, if it is NARROW, to `missed` of an
    environment; spacing, missed: as of follow_boxes."""
    if way.width < wp.float64(NARROW):
        apart = spacing
        for level in range(missed.shape[1]):
            part = wp.max(wp.float64(1.0) - way.stay / apart, wp.float64(0.0))
            missed[env, level] = missed[env, level] + part * way.pixels
            apart = apart / wp.float64(2.0)
