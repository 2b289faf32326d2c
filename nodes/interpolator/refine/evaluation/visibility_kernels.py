"""Computes z-buffer entries of single pixels by rays, first against what the pixel saw before and after."""

from functools import cache

import warp as wp

from nodes.renderer.raster.depth_kernels import MISS, entry_of, face_from, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.triangle_kernels import corners_of, edge_normal, edge_slack
from nodes.renderer.shadows.ray_kernels import Casters, hits_sphere

wp.set_module_options({"enable_backward": False})

SKY = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
"""A z-buffer entry of a pixel that sees nothing."""
FAR = wp.constant(1.0e30)
"""Depth [m] behind everything."""
OUTSIDE = wp.constant(-1.0e30)
BESIDE = wp.constant(-1.0)
"""Least weight of a corner with which a ray that just misses a triangle still counts as meeting its smooth patch."""
BACKS = wp.constant(8)
"""Most back faces that a ray passes before it is given up."""


@wp.struct
class Targets:
    """Holds the surfaces that rays can meet.

    vertices: as of triangle_kernels.corner. triangles: corners of each triangle. instance: of each triangle. two_sided:
    of each instance, 0 or 1. first: first triangle of each instance. pieces: body and front's patch of each triangle.
    albedo_scale, charts, neighbours: of each triangle, as of albedo_scale_of, charts_of and neighbours_of. casters:
    poses [R, I] of the instances in the camera's frame, with an acceleration structure for each mesh.
    """

    vertices: wp.array2d(dtype=wp.vec3)
    triangles: wp.array(dtype=wp.vec3i)
    instance: wp.array(dtype=int)
    two_sided: wp.array(dtype=int)
    first: wp.array(dtype=int)
    pieces: wp.array(dtype=wp.vec2i)
    albedo_scale: wp.array(dtype=float)
    charts: wp.array(dtype=int)
    neighbours: wp.array(dtype=wp.vec3i)
    casters: Casters


@wp.func
def weights_of(view: CameraView, targets: Targets, row: int, t: int, d: wp.vec3):
    """Computes the depth [m] at which a ray meets the plane of a triangle, the weights of the corners there, and which
    face of it that is.

    The weights are 0 or more inside the triangle, by the raster's rule, and OUTSIDE where its front is not seen.
    """
    nowhere = wp.vec3(OUTSIDE, OUTSIDE, OUTSIDE)
    i = targets.instance[t]
    turn = targets.casters.rotation[row, i]
    place = targets.casters.translation[row, i]
    a, b, c = corners_of(view, targets.vertices, targets.triangles, turn, place, row, t)
    normal = wp.cross(b - a, c - a)
    offset = wp.dot(normal, a)
    if not (offset < 0.0 or (offset > 0.0 and targets.two_sided[i] == 1)):
        return FAR, nowhere, t
    slope = wp.dot(normal, d)
    z = offset / slope
    if slope == 0.0 or z < view.near:
        return FAR, nowhere, t
    sign = wp.where(offset > 0.0, 1.0, -1.0)
    w0 = sign * wp.dot(edge_normal(b, c), d) + edge_slack(view, b, c)
    w1 = sign * wp.dot(edge_normal(c, a), d) + edge_slack(view, c, a)
    w2 = sign * wp.dot(edge_normal(a, b), d) + edge_slack(view, a, b)
    return z, wp.vec3(w0, w1, w2) / wp.abs(slope), face_from(t, offset)


@wp.func
def weights_then(view: CameraView, targets: Targets, rows: wp.vec2i, t: int, d: wp.vec3):
    """Computes 1 / depth and the weights of `weights_of`, at the instant of rows[0], or, where rows[1] is not -1, one
    step beyond it as seen from that: at a coarse frame, whose bodies are in no row."""
    z = wp.float32(0.0)
    weights = wp.vec3(0.0, 0.0, 0.0)
    seen = wp.bool(True)
    # In a loop that is not unrolled, for a GPU's cache of instructions.
    k = wp.where(rows[1] < 0, 1, 0)
    single = k == 1
    while k < 2:
        row = wp.where(k == 1, rows[0], rows[1])
        depth, found, _face = weights_of(view, targets, row, t, d)
        seen = seen and wp.min(found) > OUTSIDE
        share = wp.where(single, 1.0, wp.where(k == 1, 2.0, -1.0))
        z += share / depth
        weights += share * found
        k += 1
    if not seen:
        return 0.0, wp.vec3(OUTSIDE, OUTSIDE, OUTSIDE)
    return z, weights


@wp.func
def intersect(view: CameraView, targets: Targets, row: int, t: int, d: wp.vec3):
    """Computes the depth [m] at which a ray meets the plane of a triangle, the least weight of a corner there, and the
    face, as of `weights_of`."""
    z, weights, face = weights_of(view, targets, row, t, d)
    return z, wp.min(weights), face


@wp.func
def trace_instance(view: CameraView, targets: Targets, row: int, i: int, d: wp.vec3, until: float):
    """Casts a ray at instance i: gives depth [m] and face, or `until` and MISS if it meets none before that."""
    casters = targets.casters
    centre = casters.translation[row, i]
    length = wp.length(d)
    u = d / length
    far = until * length
    if casters.mesh[i] == wp.uint64(0) or not hits_sphere(centre, casters.radius[i], u, wp.min(far, FAR)):
        return until, MISS
    inverse = wp.transpose(casters.rotation[row, i])
    origin = -(inverse * centre)
    u = inverse * u
    start = view.near * wp.where(view.distorted == 1, 1.0, length)
    # In a loop that is not unrolled: eight copies of a query fill a GPU's cache of instructions many times over.
    left = wp.int32(BACKS)
    while left > 0:
        left -= 1
        q = wp.mesh_query_ray(casters.mesh[i], origin + start * u, u, far - start)
        if not q.result:
            return until, MISS
        slope = wp.dot(q.normal, u)
        if targets.two_sided[i] == 1 or slope < 0.0:
            return (start + q.t) / length, face_from(targets.first[i] + q.face, slope)
        start += q.t + 1.0e-5 * casters.radius[i]
    return until, MISS


@wp.func
def nearest(view: CameraView, targets: Targets, row: int, i: int, d: wp.vec3, z: float, face: int):
    """Gives depth [m] and face where a ray meets instance i, or z and `face` if it meets none of it before that."""
    nearer, hit = trace_instance(view, targets, row, i, d, z)
    if hit == MISS:
        return z, face
    return nearer, hit


@cache
def make_trace_all(trees: bool) -> wp.Function:
    """Makes the function `trace_all`; trees: whether there are any among the casters, as of `make_occlusion`."""

    @wp.func
    def trace_all(view: CameraView, targets: Targets, row: int, d: wp.vec3, behind: float, backdrop: int):
        """Casts a ray at all instances before a depth [m], where a face or nothing (MISS) is met in any case, and
        gives its z-buffer entry."""
        casters = targets.casters
        z = behind
        face = backdrop
        begin = wp.int32(0)
        end = casters.order.shape[0]
        # A ray is long code, and is written once in a kernel: it takes a GPU's compiler seconds.
        if wp.static(trees):
            length = wp.length(d)
            u = d / length
            k = wp.int32(0)
            has_still = casters.still_tree != wp.uint64(0)
            has_moving = casters.moving_tree != wp.uint64(0)
            if has_still:
                begin = casters.still
            if has_moving:
                end = casters.still
            # First what the trees of still and of moving casters give, then those that are in no tree. A query is made
            # when the one before it is through, for on a GPU all queries of a thread have the same stack.
            n = begin
            kind = wp.int32(0)
            while kind < 3:
                # Where there is no tree of a kind that of the other stands for it, and is not asked.
                tree = wp.where(has_still, casters.still_tree, casters.moving_tree)
                begun = casters.shift[row]
                way = casters.turn[row] * u
                root = wp.int32(-1)
                first = wp.int32(0)
                asked = has_still and kind == 0
                if has_moving and kind == 1:
                    tree = casters.moving_tree
                    begun = wp.vec3()
                    way = u
                    root = wp.bvh_get_group_root(tree, row)
                    first = casters.still - row * (casters.order.shape[0] - casters.still)
                    asked = True
                query = wp.bvh_query_capsule(tree, begun, way, casters.pad[row], root)
                going = wp.bool(True)
                while going:
                    i = wp.int32(-1)
                    if asked and wp.bvh_query_next(query, k, z * length):
                        i = casters.order[first + k]
                    elif kind == 2 and n < end:
                        i = casters.order[n]
                        n += 1
                    if i >= 0:
                        z, face = nearest(view, targets, row, i, d, z, face)
                    going = i >= 0
                kind += 1
        else:
            for n in range(begin, end):
                z, face = nearest(view, targets, row, casters.order[n], d, z, face)
        if face == MISS:
            return SKY
        return entry_of(z, face)

    return trace_all


@cache
def make_trace_between(trees: bool) -> wp.Function:
    """Makes the function `trace_between`; trees: as of `make_trace_all`."""
    trace_all = make_trace_all(trees)

    @wp.func
    def trace_between(
        view: CameraView,
        targets: Targets,
        row: int,
        d: wp.vec3,
        before: wp.uint64,
        after: wp.uint64,
        wholly: bool,
    ):
        """Computes the z-buffer entry of a ray at an instant between two at which it was `before` and `after`; wholly:
        also if that is neither, but nearer."""
        t = triangle_of(before)
        u = triangle_of(after)
        z = float(FAR)
        hit = wp.int32(MISS)
        z_t = float(FAR)
        z_u = float(FAR)
        in_t = float(OUTSIDE)
        in_u = float(OUTSIDE)
        face_t = wp.int32(MISS)
        face_u = wp.int32(MISS)
        if t != MISS:
            z_t, in_t, face_t = intersect(view, targets, row, t, d)
            if in_t >= 0.0:
                z = z_t
                hit = face_t
        if u != MISS and u != t:
            z_u, in_u, face_u = intersect(view, targets, row, u, d)
            if in_u >= 0.0 and z_u < z:
                z = z_u
                hit = face_u
        anything = wholly
        alike = t == u
        if t != MISS and u != MISS and not alike:
            alike = targets.pieces[t][1] == targets.pieces[u][1]
        if t != MISS or u != MISS:
            if not alike or hit == MISS:
                i = wp.int32(-1)
                last = wp.int32(-1)
                if t != MISS and in_t < 0.0:
                    i = targets.instance[t]
                if u != MISS and in_u < 0.0 and targets.instance[u] != i:
                    last = targets.instance[u]
                    i = wp.where(i < 0, last, i)
                while i >= 0:
                    z, hit = nearest(view, targets, row, i, d, z, hit)
                    i = wp.where(i == last, -1, last)
                if alike and hit == MISS and wp.max(in_t, in_u) >= BESIDE:
                    # The patch goes on between the two, although a ray just misses it.
                    hit = wp.where(in_t >= in_u, face_t, face_u)
                    z = wp.where(in_t >= in_u, z_t, z_u)
                if hit == MISS and t != MISS and u != MISS:
                    anything = True
        if anything:
            return trace_all(view, targets, row, d, z, hit)
        if hit == MISS:
            return SKY
        return entry_of(z, hit)

    return trace_between
