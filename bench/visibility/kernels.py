"""Moves a keyframe's pixels to other instants, each with its body, into z-buffers like those of the raster."""

from functools import cache

import warp as wp

from nodes.interpolator.displacement_kernels import BodyMotion, displaced
from nodes.renderer.raster.depth_kernels import MISS, depth_of, entry_of, face_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})

SKY = wp.constant(wp.uint64(0x7F800000FFFFFFFF))
"""Entry of a pixel that the sky was moved to: infinitely far, no triangle."""
HOLE = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
"""Entry of a pixel that nothing was moved to: it is behind everything."""
AROUND = wp.constant(wp.uint64(0x8000000000000000))
"""Set in entries that a point left beside its own pixel; depths have no sign, so that these are behind all others."""
SKY_NEAR = wp.constant(1.0e-6)
"""Least z of a turned direction that has an image."""


@cache
def make_project(reach: int, behind: bool) -> wp.Kernel:
    """Makes the kernel that moves a keyframe's points to other instants.

    reach: pixels beside its own that a point covers on every side. behind: there only what no point falls on."""

    @wp.kernel(module="unique", enable_backward=False)
    def project(
        # in
        view: CameraView,
        span: int,
        seen: wp.array3d(dtype=wp.uint64),
        instance: wp.array(dtype=int),
        body: wp.array(dtype=int),
        motions: wp.array2d(dtype=BodyMotion),
        # out
        packed: wp.array3d(dtype=wp.uint64),
    ):
        """Moves points of a keyframe's z-buffer into those of P instants, where the nearest one stays.

        seen: the keyframe's [1, H, W]. packed: the instants' [P, H, W]. motions [P, N + 2]: of bodies since
        then (displacement_kernels.displace). A thread does `span` pixels.
        """
        row, y, part = wp.tid()
        for x in range(part * span, wp.min(part * span + span, view.width)):
            hit = seen[0, y, x]
            t = triangle_of(hit)
            d = pixel_ray(view, x, y)
            p = d
            b = motions.shape[1] - 1
            near = SKY_NEAR
            if t != MISS:
                p = depth_of(hit) * d
                b = body[instance[t]]
                near = view.near
            m = displaced(motions, row * motions.shape[1] + b, p)
            z = p[2] + m[2]
            if z >= near:
                # The difference of two images, free of the cancellation that projecting anew would have.
                u = float(x) + view.fx * (m[0] - d[0] * m[2]) / z
                v = float(y) + view.fy * (m[1] - d[1] * m[2]) / z
                least = -0.5 - float(reach)
                if (
                    u >= least
                    and v >= least
                    and u < float(view.width + reach) - 0.5
                    and v < float(view.height + reach) - 0.5
                ):
                    column = int(wp.floor(u + 0.5))
                    line = int(wp.floor(v + 0.5))
                    entry = SKY
                    if t != MISS:
                        entry = entry_of(z, face_of(hit))
                    for j in range(-wp.static(reach), wp.static(reach) + 1):
                        for i in range(-wp.static(reach), wp.static(reach) + 1):
                            to_y = line + j
                            to_x = column + i
                            if to_y >= 0 and to_y < view.height and to_x >= 0 and to_x < view.width:
                                given = entry
                                if wp.static(behind):
                                    if i != 0 or j != 0:
                                        given = entry | AROUND
                                wp.atomic_min(packed, row, to_y, to_x, given)

    return project


@wp.kernel
def settle(
    # in
    exact: wp.array3d(dtype=wp.uint64),
    # in and out
    packed: wp.array3d(dtype=wp.uint64),
):
    """Turns z-buffers [P, H, W] into the raster's form: marks are taken off, holes are filled from `exact`."""
    row, y, x = wp.tid()
    hit = packed[row, y, x]
    if hit == HOLE:
        packed[row, y, x] = exact[row, y, x]
    elif triangle_of(hit) == MISS:
        packed[row, y, x] = HOLE
    else:
        packed[row, y, x] = hit & (AROUND - wp.uint64(1))


@wp.kernel
def repeat(
    # in
    poses: wp.array2d(dtype=wp.transformd),
    # out
    rows: wp.array2d(dtype=wp.transformd),
):
    """Copies poses [1, N] into every row of [P, N]."""
    row, n = wp.tid()
    rows[row, n] = poses[0, n]
