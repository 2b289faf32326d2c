"""The first surface that a ray meets, by the same structures that find what is in the way of light."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights_shadow_kernels import Casters, merged_holds

wp.set_module_options({"enable_backward": False})


@wp.struct
class Hit:
    """instance, -1 for none; triangle of its mesh; distance [m]; weights of the triangle's first two corners."""

    instance: int
    face: int
    distance: float
    w0: float
    w1: float


@wp.func
def nearer(
    casters: Casters,
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    env: int,
    i: int,
    origin: wp.vec3,
    direction: wp.vec3,
    hit: Hit,
):
    """The hit on instance i if it is nearer than `hit`, else that."""
    centre = translation[env, i] - origin
    along = wp.dot(centre, direction)
    away = centre - along * direction
    # The margin is the rounding of positions at this distance.
    radius = casters.radius[i] + 1.0e-6 * wp.abs(along)
    if wp.dot(away, away) <= radius * radius and along >= -radius and along - radius <= hit.distance:
        inverse = wp.transpose(rotation[env, i])
        query = wp.mesh_query_ray(casters.mesh[i], -(inverse * centre), inverse * direction, hit.distance)
        if query.result:
            found = Hit()
            found.instance = i
            found.face = query.face
            found.distance = query.t
            found.w0 = query.u
            found.w1 = query.v
            return found
    return hit


@cache
def make_first_hit(trees: bool) -> Any:
    """The function `first_hit`; without trees where there are none."""

    @wp.func
    def first_hit(
        casters: Casters,
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        env: int,
        skip: int,
        origin: wp.vec3,
        direction: wp.vec3,
        length: float,
    ):
        """The nearest hit within `length`, on any instance but `skip`."""
        hit = Hit()
        hit.instance = -1
        hit.distance = length
        count = casters.order.shape[0]
        begin = wp.int32(0)
        end = count
        if wp.static(trees):
            k = wp.int32(0)
            if casters.still_tree != wp.uint64(0):
                begin = casters.still
                turn = casters.turn[env]
                start = turn * origin + casters.shift[env]
                if merged_holds(casters, env, origin):
                    query = wp.mesh_query_ray(casters.merged, start, turn * direction, hit.distance)
                    if query.result:
                        hit.instance = casters.merged_instance[query.face]
                        hit.face = casters.merged_face[query.face]
                        hit.distance = query.t
                        hit.w0 = query.u
                        hit.w1 = query.v
                else:
                    still = wp.bvh_query_capsule(casters.still_tree, start, turn * direction, casters.pad[env])
                    while wp.bvh_query_next(still, k, hit.distance):
                        i = casters.order[k]
                        if i != skip:
                            hit = nearer(casters, rotation, translation, env, i, origin, direction, hit)
            if casters.moving_tree != wp.uint64(0):
                end = casters.still
                root = wp.bvh_get_group_root(casters.moving_tree, env)
                base = casters.still - env * (count - casters.still)
                moving = wp.bvh_query_capsule(casters.moving_tree, origin, direction, casters.pad[env], root)
                while wp.bvh_query_next(moving, k, hit.distance):
                    i = casters.order[base + k]
                    if i != skip:
                        hit = nearer(casters, rotation, translation, env, i, origin, direction, hit)
        for n in range(begin, end):
            i = casters.order[n]
            if i != skip:
                hit = nearer(casters, rotation, translation, env, i, origin, direction, hit)
        return hit

    return first_hit
