"""Computes how bodies move against the camera from one sub-frame to the next, in float64."""

import warp as wp

from nodes.interpolator.displacement_kernels import same

wp.set_module_options({"enable_backward": False})


@wp.struct
class BodyMotion:
    """Holds the motions of bodies, of the world (N) and of the sky (N + 1) at the positions 0, 1, .. of a portion, in
    row position E + env.

    A position is the sub-frame before the portion (0), one of its own (1 .. count) or keyframe B (count + 1, of the
    last portion). In the camera's frame a point p has gone by spin x p + shift since the position before, to first
    order: spin [rad], shift [m]. as_world int32 [E, N + 2]: the index to be looked up under, N for bodies that rest.
    """

    spin: wp.array2d(dtype=wp.vec3)
    shift: wp.array2d(dtype=wp.vec3)
    as_world: wp.array2d(dtype=int)


@wp.func
def pose_at(
    position: int,
    count: int,
    slot0: int,
    env: int,
    body: int,
    before: wp.array2d(dtype=wp.transformd),
    now: wp.array2d(dtype=wp.transformd),
    after: wp.array2d(dtype=wp.transformd),
):
    """Reads the pose of a body at a position: see BodyMotion."""
    if position == 0:
        return before[env, body]
    if position > count:
        return after[env, body]
    return now[(slot0 + position - 1) * before.shape[0] + env, body]


@wp.kernel
def find_body_motion(
    # in
    camera: int,
    count: int,
    closed: int,
    slot0: int,
    before: wp.array2d(dtype=wp.transformd),
    now: wp.array2d(dtype=wp.transformd),
    after: wp.array2d(dtype=wp.transformd),
    # out
    motion: BodyMotion,
):
    """Fills `motion` from poses before [E, N], now [P E, N] from slot0 on and after [E, N]; closed: 1 with B, else
    0."""
    env, body = wp.tid()
    envs = before.shape[0]
    bodies = before.shape[1]
    index = body
    if body < bodies and body != camera:
        rests = wp.bool(True)
        position = wp.int32(1)
        while rests and position <= count + closed:
            rests = same(before[env, body], pose_at(position, count, slot0, env, body, before, now, after))
            position += 1
        if rests:
            index = bodies
    motion.as_world[env, body] = index
    if index != body:
        return
    zero = wp.vec3(0.0, 0.0, 0.0)
    origin = wp.transform_get_translation(before[env, camera])
    last_turn = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    last_pivot = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for position in range(count + closed + 1):
        eye = pose_at(position, count, slot0, env, camera, before, now, after)
        turn = wp.quat_inverse(wp.normalize(wp.transform_get_rotation(eye)))
        # A point of the body in the camera's frame; of the world, where the camera was first.
        pivot = wp.quat_rotate(turn, origin - wp.transform_get_translation(eye))
        if body < bodies:
            pose = pose_at(position, count, slot0, env, body, before, now, after)
            pivot = wp.quat_rotate(turn, wp.transform_get_translation(pose) - wp.transform_get_translation(eye))
            turn = turn * wp.normalize(wp.transform_get_rotation(pose))
        row = position * envs + env
        if position == 0 or body == camera:
            motion.spin[row, body] = zero
            motion.shift[row, body] = zero
        else:
            r = turn * wp.quat_inverse(last_turn)
            sine = wp.vec3d(r[0], r[1], r[2])
            length = wp.length(sine)
            if length > wp.float64(0.0):
                angle = wp.float64(2.0) * wp.atan2(length, wp.abs(r[3]))
                sine *= wp.where(r[3] < wp.float64(0.0), -angle, angle) / length
            motion.spin[row, body] = wp.vec3(sine)
            if body == bodies + 1:
                motion.shift[row, body] = zero
            else:
                motion.shift[row, body] = wp.vec3(pivot - last_pivot - wp.cross(sine, last_pivot))
        last_turn = turn
        last_pivot = pivot
