"""Finds the outline of a mesh along an axis, by rays from many places."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def trace_silhouette(
    # in
    mesh: wp.uint64,
    size: wp.vec3,
    along: int,
    beside: int,
    ahead: int,
    # out
    seen: wp.array2d(dtype=wp.int8),
):
    """Tells whether a mesh is met from each of places [lines, places] that cover its box, which begins at the origin.

    size: of the box [m]. along, beside, ahead: its axis that lines follow, that from line to line, and that of rays.
    """
    line, place = wp.tid()
    start = wp.vec3()
    way = wp.vec3()
    start[along] = (float(place) + 0.5) / float(seen.shape[1]) * size[along]
    start[beside] = (float(line) + 0.5) / float(seen.shape[0]) * size[beside]
    thick = wp.length(size)
    start[ahead] = -thick
    way[ahead] = 1.0
    seen[line, place] = wp.int8(0)
    if wp.mesh_query_ray_anyhit(mesh, start, way, 3.0 * thick):
        seen[line, place] = wp.int8(1)
