"""Computes how far a point moves in the image: keyframes' motion vectors, and where rigid looks a point up in them."""

from functools import cache

import warp as wp

from nodes.renderer.raster.lens.distortion_kernels import angle_of, make_distorted
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

FAR_AWAY = wp.constant(1.0e6)
"""Displacement [px], both components, to a point that the camera has no image of: outside every image."""
SKY_NEAR = wp.constant(1.0e-6)
"""Near plane of the sky, which is a direction: what of it is turned behind the camera has no image."""


@cache
def make_displacement(lens: str) -> wp.Function:
    """Makes the function `displacement`. lens: `none` or a distortion model."""
    distorted = make_distorted(lens) if lens != "none" else None

    @wp.func
    def displacement(view: CameraView, d: wp.vec3, p: wp.vec3, m: wp.vec3, near: float):
        """Gives pixels from where the point p on ray d is to where p + m is; FAR_AWAY where the camera has no image of
        it: nearer than `near`, SKY_NEAR for the sky."""
        v = wp.vec2(FAR_AWAY, FAR_AWAY)
        if wp.static(distorted is not None):
            # In float64, where adding m to p keeps its digits.
            q = wp.vec3d(p) + wp.vec3d(m)
            if angle_of(q) < wp.float64(view.domain) and wp.length(q) >= wp.float64(near):
                v = wp.vec2(distorted(view, q) - distorted(view, wp.vec3d(p)))
        else:
            # Free of the cancellation that the difference of two projections would have.
            q_z = p[2] + m[2]
            if q_z >= near:
                v = wp.vec2(view.fx * (m[0] - d[0] * m[2]) / q_z, view.fy * (m[1] - d[1] * m[2]) / q_z)
        return v

    return displacement
