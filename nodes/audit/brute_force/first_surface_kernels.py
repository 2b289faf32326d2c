# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Finds the first surface that chosen rays meet, as entries of a z-buffer: a ray is cast instead of the raster.

The ray finds the triangle; depth comes from that triangle's plane by the raster's own formula, so that where both find
the same triangle the entries are equal to the last bit.
"""

from functools import cache

import warp as wp

from nodes.renderer.paths.first_hit_kernels import make_first_hit
from nodes.renderer.raster.bounds_kernels import facing
from nodes.renderer.raster.depth_kernels import MISS, entry_of, face_from
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import listed_pixel
from nodes.renderer.raster.triangle_kernels import corners_of
from nodes.renderer.shadows.ray_kernels import LIFT, MOST_BACKS, REACH, Casters

wp.set_module_options({"enable_backward": False})


@cache
def make_first_surface(trees: bool) -> wp.Kernel:
    """Makes the kernel `first_surface`. trees: whether the casters have any."""
    first_hit = make_first_hit(trees, False)

    @wp.kernel(module="unique", enable_backward=False)
    def first_surface(
        # in
        view: CameraView,
        lens: int,
        listed: wp.array(dtype=int),
        casters: Casters,
        first: wp.array(dtype=int),
        two_sided: wp.array(dtype=int),
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        # out
        packed: wp.array3d(dtype=wp.uint64),
        triangle: wp.array(dtype=int),
    ):
        """Fills the z-buffer at listed pixels, indices into [E, H, W], and names their triangles, -1 for none.

        lens: 1 where rays are unit vectors and depth is the distance along them.
        """
        j = wp.tid()
        pixel = listed_pixel(view, listed[j])
        env = pixel.env
        d = view.rays[pixel.y, pixel.x]
        length = wp.length(d)
        found = wp.int32(-1)
        face = wp.int32(MISS)
        z = float(0.0)
        if length > 0.0:
            direction = d / length
            origin = view.near * d
            turn = int(0)
            while turn < MOST_BACKS:
                hit = first_hit(casters, env, -1, origin, direction, REACH)
                turn += 1
                i = hit.instance
                if i < 0:
                    turn = MOST_BACKS
                else:
                    t = first[i] + hit.face
                    a, b, c = corners_of(
                        view, vertices, triangles, casters.rotation[env, i], casters.translation[env, i], env, t
                    )
                    if facing(a, b, c, two_sided[i]):
                        found = t
                        normal = wp.cross(b - a, c - a)
                        face = face_from(t, wp.dot(normal, a))
                        z = wp.dot(normal, a) / (normal[0] * d[0] + (normal[1] * d[1] + normal[2] * d[2]))
                        low = wp.min(a[2], wp.min(b[2], c[2]))
                        high = wp.max(a[2], wp.max(b[2], c[2]))
                        if lens == 1:
                            low = wp.abs(wp.dot(normal, a)) / wp.length(normal)
                            high = wp.max(wp.length(a), wp.max(wp.length(b), wp.length(c)))
                        z = wp.clamp(z, wp.max(low, view.near), wp.max(high, view.near))
                        turn = MOST_BACKS
                    else:
                        # Beyond this back by more than the rounding of where it is.
                        past = hit.distance + LIFT * (wp.length(origin) + hit.distance + casters.radius[i])
                        origin = origin + past * direction
        triangle[j] = found
        entry = wp.uint64(0xFFFFFFFFFFFFFFFF)
        if found >= 0:
            entry = entry_of(z, face)
        packed[env, pixel.y, pixel.x] = entry

    return first_surface
