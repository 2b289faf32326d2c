"""Turns body poses into what the camera sees of them, in float64: only the result is rounded to float32.

The camera's position is subtracted first, so that nothing is lost far from the origin. Multiplications and additions
are not fused, so that every device gives the same bits.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def matrix_of(q: wp.quatd):
    """Gives the rotation matrix of a quaternion of any length but 0."""
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    norm = wp.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    x = q[0] / norm
    y = q[1] / norm
    z = q[2] / norm
    w = q[3] / norm
    return wp.mat33d(
        one - two * (y * y + z * z), two * (x * y - z * w), two * (x * z + y * w),
        two * (x * y + z * w), one - two * (x * x + z * z), two * (y * z - x * w),
        two * (x * z - y * w), two * (y * z + x * w), one - two * (x * x + y * y),
    )  # fmt: skip


@wp.func
def seen_from(poses: wp.array2d(dtype=wp.transformd), env: int, body: int, camera: int):
    """Gives the rotation and translation of a body (-1 = the world) to the frame of the body `camera`."""
    eye = poses[env, camera]
    to_camera = wp.transpose(matrix_of(wp.transform_get_rotation(eye)))
    turn = to_camera
    place = -wp.transform_get_translation(eye)
    if body >= 0:
        pose = poses[env, body]
        turn = to_camera * matrix_of(wp.transform_get_rotation(pose))
        place = wp.transform_get_translation(pose) + place
    return turn, to_camera * place


@wp.func
def instance_seen(
    poses: wp.array2d(dtype=wp.transformd),
    env: int,
    camera: int,
    body: int,
    rotation: wp.mat33d,
    translation: wp.vec3d,
):
    """Gives the rotation and translation of an instance, which has a place in its body's frame."""
    turn, place = seen_from(poses, env, body, camera)
    return turn * rotation, place + turn * translation


@wp.kernel
def place_instances(
    # in
    poses: wp.array2d(dtype=wp.transformd),
    camera: int,
    start: int,
    order: wp.array(dtype=int),
    body: wp.array(dtype=int),
    rest_rotation: wp.array(dtype=wp.mat33d),
    rest_translation: wp.array(dtype=wp.vec3d),
    # out
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    eye: wp.array(dtype=wp.mat33),
):
    """Places instances order[start ...] in the camera frame.

    Args:
        poses: [E, N] of the bodies, to the world.
        camera: body of the camera.
        start: first entry of `order`.
        order: [I + 1] instances; the entry after the last instance, I, stands for the camera itself.
        body: [I] of each instance, -1 = the world.
        rest_rotation: [I] instance to its body.
        rest_translation: [I] m, the same.
        rotation: [E, I] instance to camera.
        translation: [E, I] m, the same.
        eye: [E] camera to world.
    """
    env, k = wp.tid()
    i = order[start + k]
    if i == body.shape[0]:
        eye[env] = wp.mat33(matrix_of(wp.transform_get_rotation(poses[env, camera])))
    else:
        turn, place = instance_seen(poses, env, camera, body[i], rest_rotation[i], rest_translation[i])
        rotation[env, i] = wp.mat33(turn)
        translation[env, i] = wp.vec3(place)


@wp.kernel
def displace_instances(
    # in
    poses: wp.array2d(dtype=wp.transformd),
    before: wp.array2d(dtype=wp.transformd),
    camera: int,
    start: int,
    order: wp.array(dtype=int),
    body: wp.array(dtype=int),
    rest_rotation: wp.array(dtype=wp.mat33d),
    rest_translation: wp.array(dtype=wp.vec3d),
    # out
    turn_out: wp.array2d(dtype=wp.mat33),
    shift_out: wp.array2d(dtype=wp.vec3),
):
    """Computes D - 1 of the map D from an instance's point in this camera frame to the same point in that of `before`.

    The entry after the last instance is the sky, which only turns. Exactly zero for what is where it was.

    Args:
        poses: [E, N] of the bodies, to the world.
        before: [E, N] the same at the instant before.
        camera, start, order, body, rest_rotation, rest_translation: as of `place_instances`.
        turn_out: [E, I + 1] linear part of D - 1.
        shift_out: [E, I + 1] m, constant part.
    """
    env, k = wp.tid()
    i = order[start + k]
    turn = wp.mat33d()
    shift = wp.vec3d()
    one = wp.identity(n=3, dtype=wp.float64)
    if i == body.shape[0]:
        now = matrix_of(wp.transform_get_rotation(poses[env, camera]))
        then = matrix_of(wp.transform_get_rotation(before[env, camera]))
        if not (now == then):
            turn = wp.transpose(then) * now - one
    else:
        rotation, place = instance_seen(poses, env, camera, body[i], rest_rotation[i], rest_translation[i])
        rotation_then, place_then = instance_seen(before, env, camera, body[i], rest_rotation[i], rest_translation[i])
        if not (rotation == rotation_then and place == place_then):
            back = rotation_then * wp.transpose(rotation)
            turn = back - one
            shift = place_then - back * place
    turn_out[env, i] = wp.mat33(turn)
    shift_out[env, i] = wp.vec3(shift)


@wp.kernel
def move_bodies(
    # in
    fresh: wp.array3d(dtype=wp.float64),
    movers: wp.array(dtype=int),
    # in and out
    now: wp.array3d(dtype=wp.float64),
    # out
    before: wp.array3d(dtype=wp.float64),
):
    """Moves the poses [E, N, 7] of the bodies `movers` one step on."""
    env, m, c = wp.tid()
    body = movers[m]
    before[env, body, c] = now[env, body, c]
    now[env, body, c] = fresh[env, m, c]
