"""Casts primary rays, and counts the pixels in which they and the raster see different things."""

import warp as wp

from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})


@wp.kernel
def cast_rays(
    # in
    view: CameraView,
    mesh: wp.uint64,
    # out
    triangle: wp.array3d(dtype=int),
    depth: wp.array3d(dtype=float),
):
    """Casts one primary ray per pixel from the camera, at the origin."""
    env, y, x = wp.tid()
    query = wp.mesh_query_ray(mesh, wp.vec3(0.0, 0.0, 0.0), pixel_ray(view, x, y), 1.0e6)
    triangle[env, y, x] = wp.where(query.result, query.face, MISS)
    depth[env, y, x] = query.t


@wp.kernel
def differing(
    # in
    packed: wp.array3d(dtype=wp.uint64),
    triangle: wp.array3d(dtype=int),
    depth: wp.array3d(dtype=float),
    # out
    count: wp.array(dtype=int),
):
    """Counts pixels where raster and rays disagree: one sees nothing, or the depths are more than 1e-4 apart."""
    env, y, x = wp.tid()
    hit = packed[env, y, x]
    if (triangle_of(hit) == MISS) != (triangle[env, y, x] == MISS):
        wp.atomic_add(count, 0, 1)
    elif triangle_of(hit) != MISS and wp.abs(depth_of(hit) / depth[env, y, x] - 1.0) > 1.0e-4:
        wp.atomic_add(count, 0, 1)
