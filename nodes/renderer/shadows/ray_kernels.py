"""Finds what is in the way of light: rays against the instances, and a test that saves most of them.

Few instances are tried one by one. Many still ones lie in a tree in the world's frame that is built once, many moving
ones in a tree in the camera's frame, a group of it for each environment, that is refitted. The trees leave out only
what the test of a single instance would, so the result does not depend on them. Rays that start far enough from their
surface for the rounding of the world's frame go through all triangles of the still ones at once instead.
"""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.reading_kernels import matrix_at, vector_at

wp.set_module_options({"enable_backward": False})

CONVEX = wp.constant(1)
PLANAR = wp.constant(2)

LIFT = wp.constant(4.0e-6)
"""Start of a shadow ray above its surface, of the distance plus the instance's size: tens of float32 roundings."""

REACH = wp.constant(1.0e9)
"""Length of a ray that looks for the first surface [m]."""

MOST_BACKS = wp.constant(64)
"""Backs of surfaces, which are not seen, that such a ray goes through at most."""

ROUNDING = wp.constant(1.0e-6)
"""Of positions, of their distance: some tens of float32 roundings."""


@wp.struct
class Casters:
    """Holds instances as occluders. mesh [I] ids; radius and shell [I]; order [I]: still ones first, `still` of them.

    Half the sides of boxes [I] in their own frames: box: of those that are one, else 0; outer: of one around each;
    core: of one within each that is convex, else 0.
    """

    rotation: wp.array2d(dtype=wp.mat33)
    """[E, I] frame to the camera's, with `translation`."""
    translation: wp.array2d(dtype=wp.vec3)
    mesh: wp.array(dtype=wp.uint64)
    radius: wp.array(dtype=float)
    shell: wp.array(dtype=int)
    box: wp.array(dtype=wp.vec3)
    outer: wp.array(dtype=wp.vec3)
    core: wp.array(dtype=wp.vec3)
    order: wp.array(dtype=int)
    still: int
    is_still: wp.array(dtype=int)
    still_tree: wp.uint64
    """Boxes of order[0 .. still), or 0 for none."""
    moving_tree: wp.uint64
    """Boxes of order[still ..) of all environments, or 0 for none."""
    turn: wp.array(dtype=wp.mat33)
    """[E] camera to the still tree's frame, with `shift`."""
    shift: wp.array(dtype=wp.vec3)
    merged: wp.uint64
    """All triangles of order[0 .. still) in the still tree's frame, or 0 for none."""
    merged_instance: wp.array(dtype=int)
    merged_face: wp.array(dtype=int)
    """Of each merged triangle."""
    pad: wp.array(dtype=float)
    """[E] how much wider than a ray the trees are searched [m]: the rounding of positions in their frames."""


@wp.func
def translation_of(casters: Casters, env: int, i: int):
    """Gives where an instance is in the camera's frame [m]."""
    return vector_at(casters.translation, env * casters.translation.shape[1] + i)


@wp.func
def rotation_of(casters: Casters, env: int, i: int):
    """Gives the rotation of an instance to the camera's frame."""
    return matrix_at(casters.rotation, env * casters.rotation.shape[1] + i)


@wp.func
def shadow_start(casters: Casters, i: int, position: wp.vec3, normal: wp.vec3, front: bool):
    """Finds where shadow rays of instance i start, and whom they leave out: an instance that cannot shade itself
    here."""
    alone = wp.int32(-1)
    if casters.shell[i] == PLANAR or (casters.shell[i] == CONVEX and front):
        alone = i
    return position + (LIFT * (wp.length(position) + casters.radius[i])) * normal, alone


@wp.func
def merged_holds(casters: Casters, env: int, origin: wp.vec3):
    """Tells whether a ray from a surface may use the merged mesh, which cannot leave out that surface.

    It starts LIFT times the distance above it, at least. pad is some ten times the rounding of a place in that mesh.
    """
    return casters.merged != wp.uint64(0) and LIFT * wp.length(origin) >= 0.1 * casters.pad[env]


@wp.func
def hits_sphere(centre: wp.vec3, radius: float, direction: wp.vec3, length: float):
    """Tells whether a ray from the origin meets a ball; its radius grows by the rounding of positions at this
    distance."""
    along = wp.dot(centre, direction)
    away = centre - along * direction
    wide = radius + ROUNDING * wp.abs(along)
    return wp.dot(away, away) <= wide * wide and along >= -wide and along - wide <= length


# Comparisons of C++ are one instruction each on a CPU, and fminf and fmaxf on a GPU, where Warp's min and max look for
# what is not a number. With such a box nothing is compared as less, or it is left out, and the ends stay.
SLAB_TEST = """
    float near = -3.0e38f, far = 3.0e38f;
    for (int k = 0; k < 3; ++k) {
        const float t0 = lower[k] * inverse[k], t1 = upper[k] * inverse[k];
#if defined(__CUDA_ARCH__)
        near = fmaxf(near, fminf(t0, t1));
        far = fminf(far, fmaxf(t0, t1));
#else
        const float first = t0 < t1 ? t0 : t1, last = t0 < t1 ? t1 : t0;
        near = near < first ? first : near;
        far = last < far ? last : far;
#endif
    }
    return wp::vec_t<2, wp::float32>(near, far);
"""


@wp.func_native(SLAB_TEST)
def slab_test(lower: wp.vec3, upper: wp.vec3, inverse: wp.vec3) -> wp.vec2:
    """Computes where a ray from the origin enters and leaves a box, in lengths of its direction (the slab test; Kay and
    Kajiya, 1986); it misses the box where it leaves before it enters.

    inverse: of the ray's direction, of `inverse_of`.
    """
    ...


@wp.func
def inverse_of(direction: wp.vec3):
    """Gives the inverse of a ray's components; of those that are 0 a number so large that FAR is not beyond it."""
    inverse = wp.vec3()
    for k in range(3):
        inverse[k] = wp.where(wp.abs(direction[k]) < 1.0e-12, 3.0e38, 1.0 / direction[k])
    return inverse


@wp.func
def hits_box(lower: wp.vec3, upper: wp.vec3, inverse: wp.vec3, length: float):
    """Tells whether any of a ray from the origin, within `length`, is in a box; so it is in one that is no number."""
    ends = slab_test(lower, upper, inverse)
    return ends[0] <= ends[1] and ends[1] >= 0.0 and ends[0] <= length


@wp.func
def hits_box_side(half: wp.vec3, start: wp.vec3, direction: wp.vec3, length: float):
    """Tells whether a ray meets a side of a box about the origin, from outside or inside; half: of its sides."""
    ends = slab_test(-half - start, half - start, inverse_of(direction))
    met = wp.where(ends[0] < 0.0, ends[1], ends[0])
    return ends[0] <= ends[1] and met >= 0.0 and met <= length


@wp.func
def hits_instance(
    casters: Casters,
    env: int,
    i: int,
    origin: wp.vec3,
    direction: wp.vec3,
    length: float,
    extent: float,
):
    """Tells whether a ray meets instance i. extent: not read; all tests of `make_search` have the same arguments.

    Its triangles, or its sides if it is a box, are tried only if its bounding sphere is hit, and triangles only where
    boxes do not tell: a ray that misses the outer one misses them, and one that comes from outside and goes through the
    core meets them.
    """
    centre = translation_of(casters, env, i) - origin
    if hits_sphere(centre, casters.radius[i], direction, length):
        inverse = wp.transpose(rotation_of(casters, env, i))
        start = -(inverse * centre)
        along = inverse * direction
        half = casters.box[i]
        if half[0] + half[1] > 0.0:
            return hits_box_side(half, start, along, length)
        wide = ROUNDING * wp.length(start)
        slack = wp.vec3(wide, wide, wide)
        slopes = inverse_of(along)
        outer = casters.outer[i] + slack
        ends = slab_test(-outer - start, outer - start, slopes)
        if ends[0] > ends[1] or ends[1] < 0.0 or ends[0] > length:
            return False
        core = casters.core[i] - slack
        if ends[0] > 0.0 and wp.min(core) > 0.0:
            if hits_box(-core - start, core - start, slopes, length):
                return True
        if wp.mesh_query_ray_anyhit(casters.mesh[i], start, along, length):
            return True
    return False


@wp.func
def meets_hull(
    casters: Casters,
    env: int,
    i: int,
    origin: wp.vec3,
    direction: wp.vec3,
    length: float,
    extent: float,
):
    """Tells whether the bounding sphere of instance i meets the hull of a point and a ball."""
    sine = extent / length
    cosine = wp.sqrt(1.0 - sine * sine)
    centre = translation_of(casters, env, i) - origin
    along = wp.dot(centre, direction)
    away = wp.length(centre - along * direction)
    radius = casters.radius[i] + ROUNDING * wp.abs(along)
    return along >= -radius and along - radius <= length + extent and away * cosine - along * sine <= radius


def make_search(test: Any, trees: bool) -> tuple[Any, Any]:
    """Makes the functions that look for a caster that fulfils `test`: among the still ones in their tree, and among
    others.

    Trees are searched as far as the ray's `length` and around it as far as `pad`, and `extent` further.
    """

    @wp.func
    def in_still_tree(
        casters: Casters,
        env: int,
        skip: int,
        origin: wp.vec3,
        direction: wp.vec3,
        length: float,
        extent: float,
    ):
        """Tells whether a still caster but `skip` fulfils the test, by their tree."""
        turn = casters.turn[env]
        start = turn * origin + casters.shift[env]
        query = wp.bvh_query_capsule(casters.still_tree, start, turn * direction, casters.pad[env] + extent)
        k = wp.int32(0)
        while wp.bvh_query_next(query, k, length + extent):
            i = casters.order[k]
            if i != skip:
                if test(casters, env, i, origin, direction, length, extent):
                    return True
        return False

    @wp.func
    def elsewhere(
        casters: Casters,
        env: int,
        begin: int,
        last: int,
        skip: int,
        origin: wp.vec3,
        direction: wp.vec3,
        length: float,
        extent: float,
    ):
        """Tells whether a caster of order[begin..last) fulfils the test, of moving ones by their tree."""
        end = int(last)
        if wp.static(trees):
            if casters.moving_tree != wp.uint64(0) and last > casters.still:
                end = casters.still
                root = wp.bvh_get_group_root(casters.moving_tree, env)
                width = casters.pad[env] + extent
                query = wp.bvh_query_capsule(casters.moving_tree, origin, direction, width, root)
                base = casters.still - env * (casters.order.shape[0] - casters.still)
                k = wp.int32(0)
                while wp.bvh_query_next(query, k, length + extent):
                    i = casters.order[base + k]
                    if i != skip:
                        if test(casters, env, i, origin, direction, length, extent):
                            return True
        for n in range(begin, end):
            i = casters.order[n]
            if i != skip:
                if test(casters, env, i, origin, direction, length, extent):
                    return True
        return False

    return in_still_tree, elsewhere


@cache
def make_occlusion(trees: bool, merged: bool) -> tuple[Any, Any]:
    """Makes the functions `occluded` and `may_occlude`; without trees where there are none, for even unused they cost.

    merged: there may be a mesh of all still triangles.
    """
    hit_still, hit_elsewhere = make_search(hits_instance, trees)
    near_still, near_elsewhere = make_search(meets_hull, trees)

    @wp.func
    def occluded(
        casters: Casters,
        env: int,
        first: int,
        last: int,
        skip: int,
        origin: wp.vec3,
        direction: wp.vec3,
        length: float,
    ):
        """Tells whether casters order[first..last) but `skip` are in the way; the range ends at `still` or at the
        end."""
        begin = int(first)
        if wp.static(trees):
            if casters.still_tree != wp.uint64(0) and first == 0 and last >= casters.still:
                begin = casters.still
                tried = wp.bool(False)
                if wp.static(merged):
                    if merged_holds(casters, env, origin):
                        tried = True
                        turn = casters.turn[env]
                        start = turn * origin + casters.shift[env]
                        if wp.mesh_query_ray_anyhit(casters.merged, start, turn * direction, length):
                            return True
                if not tried:
                    if hit_still(casters, env, skip, origin, direction, length, 0.0):
                        return True
        return hit_elsewhere(casters, env, begin, last, skip, origin, direction, length, 0.0)

    @wp.func
    def may_occlude(
        casters: Casters,
        env: int,
        first: int,
        last: int,
        skip: int,
        origin: wp.vec3,
        direction: wp.vec3,
        length: float,
        extent: float,
    ):
        """Tells whether casters order[first..last) but `skip` may be in the way of rays from a point to a ball.

        The ball has radius `extent` and lies `length` away; what lies outside the hull of both can shade nothing of it.
        """
        if extent >= length:
            return first < last
        begin = int(first)
        if wp.static(trees):
            if casters.still_tree != wp.uint64(0) and first == 0 and last >= casters.still:
                begin = casters.still
                if near_still(casters, env, skip, origin, direction, length, extent):
                    return True
        return near_elsewhere(casters, env, begin, last, skip, origin, direction, length, extent)

    return occluded, may_occlude
