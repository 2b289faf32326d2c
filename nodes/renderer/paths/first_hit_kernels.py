"""Finds the first surface that a ray meets, by the same structures that find what is in the way of light."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.shadows.ray_kernels import Casters, hits_sphere, merged_holds

wp.set_module_options({"enable_backward": False})


@wp.struct
class RayHit:
    """Holds instance, -1 for none; triangle of its mesh; distance [m]; weights of the triangle's first two corners."""

    instance: int
    face: int
    distance: float
    w0: float
    w1: float


@wp.func
def nearer_hit(
    casters: Casters,
    env: int,
    i: int,
    origin: wp.vec3,
    direction: wp.vec3,
    hit: RayHit,
):
    """Gives the hit on instance i if it is nearer than `hit`, else that."""
    centre = casters.translation[env, i] - origin
    if hits_sphere(centre, casters.radius[i], direction, hit.distance):
        inverse = wp.transpose(casters.rotation[env, i])
        query = wp.mesh_query_ray(casters.mesh[i], -(inverse * centre), inverse * direction, hit.distance)
        if query.result:
            found = RayHit()
            found.instance = i
            found.face = query.face
            found.distance = query.t
            found.w0 = query.u
            found.w1 = query.v
            return found
    return hit


@cache
def make_first_hit(trees: bool, merged: bool) -> Any:
    """Makes the function `first_hit`; without trees where there are none; merged: as of `make_occlusion`."""

    @wp.func
    def first_hit(
        casters: Casters,
        env: int,
        skip: int,
        origin: wp.vec3,
        direction: wp.vec3,
        length: float,
    ):
        """Gives the nearest hit within `length`, on any instance but `skip`."""
        hit = RayHit()
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
                tried = wp.bool(False)
                if wp.static(merged):
                    if merged_holds(casters, env, origin):
                        tried = True
                        query = wp.mesh_query_ray(casters.merged, start, turn * direction, hit.distance)
                        if query.result:
                            hit.instance = casters.merged_instance[query.face]
                            hit.face = casters.merged_face[query.face]
                            hit.distance = query.t
                            hit.w0 = query.u
                            hit.w1 = query.v
                if not tried:
                    still = wp.bvh_query_capsule(casters.still_tree, start, turn * direction, casters.pad[env])
                    while wp.bvh_query_next(still, k, hit.distance):
                        i = casters.order[k]
                        if i != skip:
                            hit = nearer_hit(casters, env, i, origin, direction, hit)
            if casters.moving_tree != wp.uint64(0):
                end = casters.still
                root = wp.bvh_get_group_root(casters.moving_tree, env)
                base = casters.still - env * (count - casters.still)
                moving = wp.bvh_query_capsule(casters.moving_tree, origin, direction, casters.pad[env], root)
                while wp.bvh_query_next(moving, k, hit.distance):
                    i = casters.order[base + k]
                    if i != skip:
                        hit = nearer_hit(casters, env, i, origin, direction, hit)
        for n in range(begin, end):
            i = casters.order[n]
            if i != skip:
                hit = nearer_hit(casters, env, i, origin, direction, hit)
        return hit

    return first_hit
