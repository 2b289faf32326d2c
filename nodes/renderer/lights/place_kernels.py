"""Brings lights from their bodies' frames to the camera's, in float64: only the result is rounded."""

import warp as wp

from nodes.renderer.geometry.pose_kernels import seen_from

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def place_lights(
    # in
    poses: wp.array2d(dtype=wp.transformd),
    camera: int,
    body: wp.array(dtype=int),
    positional: wp.array(dtype=int),
    fixed: wp.array2d(dtype=wp.vec3d),
    # out
    vector: wp.array2d(dtype=wp.vec3),
    axis: wp.array2d(dtype=wp.vec3),
    half_u: wp.array2d(dtype=wp.vec3),
    half_v: wp.array2d(dtype=wp.vec3),
):
    """Brings the lights from their bodies' frames to the camera's.

    Args:
        poses: [E, N] of the bodies, to the world.
        camera: body of the camera.
        body: [L] of each light, -1 = the world.
        positional: [L] 1 where the vector is a place, 0 where it is a direction.
        fixed: [4, L] the four of lights.fixed_vectors, in the frames of the bodies.
        vector: [E, L] of `Lights`, as `axis`, `half_u` and `half_v`.
    """
    env, l = wp.tid()
    turn, place = seen_from(poses, env, body[l], camera)
    at = turn * fixed[0, l]
    if positional[l] == 1:
        at = at + place
    vector[env, l] = wp.vec3(at)
    axis[env, l] = wp.vec3(turn * fixed[1, l])
    half_u[env, l] = wp.vec3(turn * fixed[2, l])
    half_v[env, l] = wp.vec3(turn * fixed[3, l])
