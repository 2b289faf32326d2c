"""Computes what a direction from the camera meets at an instant, and how that surface moves in the image.

A thread is a question. Every question has a time of its own, so poses are worked out for it alone, and rays meet meshes
in the meshes' own frames, where float32 resolves them best.
"""

import warp as wp

from nodes.labeler.rays.motion_kernels import Motion, fraction, gap_at, pose_of, state_of
from nodes.renderer.shadows.ray_kernels import LIFT, MOST_BACKS, REACH

wp.set_module_options({"enable_backward": False})


@wp.struct
class Surfaces:
    """Holds the surfaces that can be seen: instances [I], each a mesh (id 0 for an empty one) about its middle, on a
    body.
    """

    mesh: wp.array(dtype=wp.uint64)
    body: wp.array(dtype=wp.int32)
    offset: wp.array(dtype=wp.transformd)
    """Of the mesh's middle and axes in the body's frame."""
    radius: wp.array(dtype=wp.float32)
    two_sided: wp.array(dtype=wp.int32)
    camera: wp.int32
    """Body of the camera."""
    near: wp.float64
    """Depth along the optical axis, or distance where `lens` is 1, before which nothing is seen [m]."""
    lens: wp.int32


@wp.func
def first_hit(
    surfaces: Surfaces, i: wp.int32, origin: wp.vec3, direction: wp.vec3, reach: wp.float32
):  # fmt: skip
    """Finds how far along a ray of the mesh's own frame its first visible triangle is, `reach` where there is none, and
    the triangle's normal there."""
    mesh = surfaces.mesh[i]
    gone = wp.float32(0.0)
    turn = wp.int32(0)
    found = reach
    normal = wp.vec3()
    while turn < MOST_BACKS and gone < reach:
        query = wp.mesh_query_ray(mesh, origin + gone * direction, direction, reach - gone)
        turn += 1
        if not query.result:
            turn = MOST_BACKS
        elif surfaces.two_sided[i] != 0 or wp.dot(query.normal, direction) < wp.float32(0.0):
            found = gone + query.t
            normal = query.normal
            turn = MOST_BACKS
        else:
            gone += query.t + LIFT * (wp.length(origin) + gone + query.t + surfaces.radius[i])
    return found, normal


@wp.func
def in_the_way(surfaces: Surfaces, i: wp.int32, to: wp.vec3d, ahead: wp.vec3d, reach: wp.float32):
    """Tells whether a ray could meet an instance, whose middle is at `to` from the ray's start, before `reach`."""
    along = wp.dot(to, ahead)
    away = to - along * ahead
    radius = wp.float64(surfaces.radius[i])
    wide = radius + wp.float64(1.0e-9) * wp.abs(along)
    return wp.dot(away, away) <= wide * wide and along >= -wide and along - wide <= wp.float64(reach)


@wp.func
def beginning(surfaces: Surfaces, direction: wp.vec3d):
    """Computes the distance in a direction, of the camera's frame, from which on surfaces are seen (the near plane)."""
    begin = surfaces.near
    if surfaces.lens == 0:
        begin = surfaces.near / direction[2]
    return begin


@wp.kernel
def first_surfaces(
    # in
    surfaces: Surfaces,
    motion: Motion,
    envs: wp.array(dtype=wp.int32),
    times: wp.array(dtype=wp.int64),
    directions: wp.array(dtype=wp.vec3d),
    # out
    instances: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
):
    """Finds the first surface in a direction.

    Args:
        surfaces: what there is.
        motion: where it is.
        envs: environment of each question [Q].
        times: of each [Q] ns.
        directions: of each [Q], unit vectors in the camera's frame; NaN sees nothing.
        instances: [Q] ids, 0 for the background.
        distances: [Q] from the camera's centre [m], inf for the background.
    """
    n = wp.tid()
    env = envs[n]
    d = directions[n]
    instances[n] = 0
    distances[n] = wp.inf
    if not wp.isfinite(wp.length(d)):
        return
    gap = gap_at(motion, times[n])
    u = fraction(motion, gap, times[n])
    eye = pose_of(motion, env, surfaces.camera, gap, u)
    ahead = wp.transform_vector(eye, d)
    begin = beginning(surfaces, d)
    start = wp.transform_get_translation(eye) + begin * ahead
    reach = wp.float32(REACH)
    for i in range(surfaces.mesh.shape[0]):
        if surfaces.mesh[i] != wp.uint64(0):
            frame = wp.transform_multiply(pose_of(motion, env, surfaces.body[i], gap, u), surfaces.offset[i])
            to = wp.transform_get_translation(frame) - start
            if in_the_way(surfaces, i, to, ahead, reach):
                back = wp.quat_inverse(wp.transform_get_rotation(frame))
                local = wp.vec3(wp.quat_rotate(back, -to))
                towards = wp.vec3(wp.quat_rotate(back, ahead))
                distance, _normal = first_hit(surfaces, i, local, towards, reach)
                if distance < reach:
                    reach = distance
                    instances[n] = i + 1
    if instances[n] > 0:
        distances[n] = wp.float32(begin + wp.float64(reach))


@wp.kernel
def flow_of_surfaces(
    # in
    surfaces: Surfaces,
    motion: Motion,
    envs: wp.array(dtype=wp.int32),
    times: wp.array(dtype=wp.int64),
    directions: wp.array(dtype=wp.vec3d),
    image: wp.array2d(dtype=wp.vec3d),
    instances: wp.array(dtype=wp.int32),
    distances: wp.array(dtype=wp.float32),
    # out
    flow: wp.array2d(dtype=wp.float32),
):
    """Computes the image velocity of surface points, (5.16) in Ma et al., An Invitation to 3-D Vision.

    Args:
        surfaces, motion, envs, times, directions: as of `first_surfaces`.
        image: d(pixel) / d(X, Y, Z) at the directions [Q, 2], a row for u and one for v.
        instances, distances: the surface of each question.
        flow: [Q, 2] px/s, NaN for the background.
    """
    n = wp.tid()
    if instances[n] == 0:
        flow[n, 0] = wp.nan
        flow[n, 1] = wp.nan
        return
    env = envs[n]
    gap = gap_at(motion, times[n])
    u = fraction(motion, gap, times[n])
    eye = state_of(motion, env, surfaces.camera, gap, u)
    thing = state_of(motion, env, surfaces.body[instances[n] - 1], gap, u)
    distance = wp.float64(distances[n])
    point = wp.transform_point(eye.pose, distance * directions[n])
    # The point moves with its body, and is looked at from a camera that moves and turns.
    moved = thing.velocity + wp.cross(thing.turning, point - wp.transform_get_translation(thing.pose))
    arm = point - wp.transform_get_translation(eye.pose)
    seen = moved - eye.velocity - wp.cross(eye.turning, arm)
    moving = wp.quat_rotate(wp.quat_inverse(wp.transform_get_rotation(eye.pose)), seen) / distance
    flow[n, 0] = wp.float32(wp.dot(image[n, 0], moving))
    flow[n, 1] = wp.float32(wp.dot(image[n, 1], moving))
