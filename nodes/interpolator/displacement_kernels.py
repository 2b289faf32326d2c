"""Computes where a body's points seen at a sub-frame were in the camera at a keyframe, in float64."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("return wp::add(wp::mul(turn.data[at], point), shift.data[at]);")
def displaced(
    turn: wp.array2d(dtype=wp.mat33), shift: wp.array2d(dtype=wp.vec3), at: wp.int32, point: wp.vec3
) -> wp.vec3:
    """Computes how far a point of a body has moved since a keyframe, in its camera frame [m]; at: place of the body in
    what `displace` has made in memory."""
    ...


@wp.func_native("return wp::add(direction, wp::mul(turn.data[at], direction));")
def turned_back(turn: wp.array2d(dtype=wp.mat33), at: wp.int32, direction: wp.vec3) -> wp.vec3:
    """Computes what a direction fixed to a body was in the camera frame of a keyframe; at: as of `displaced`."""
    ...


@wp.func
def turn_of(pose: wp.transformd):
    """Makes the rotation matrix of a pose."""
    return wp.quat_to_matrix(wp.normalize(wp.transform_get_rotation(pose)))


@wp.func
def same(a: wp.transformd, b: wp.transformd):
    """Tells whether two poses are equal to the last bit."""
    for i in range(7):
        if a[i] != b[i]:
            return False
    return True


@wp.kernel
def displace(
    # in
    camera: int,
    now: wp.array2d(dtype=wp.transformd),
    then: wp.array2d(dtype=wp.transformd),
    # out
    turn: wp.array2d(dtype=wp.mat33),
    shift: wp.array2d(dtype=wp.vec3),
):
    """Computes D - 1 of the map D from a point in the camera frame now to the same body's point in the camera frame
    then.

    now [P E, N] and then [E, N]: poses of bodies in the world; environments repeat. turn and shift [P E, N + 2]: entry
    N is the world and N + 1 the sky, which only turns. Exactly zero for what is where it was.
    """
    row, body = wp.tid()
    env = row % then.shape[0]
    bodies = now.shape[1]
    cam_now = now[row, camera]
    cam_then = then[env, camera]
    zero = wp.vec3(0.0, 0.0, 0.0)
    moved = not same(cam_now, cam_then)
    if body < bodies:
        moved = moved or not same(now[row, body], then[env, body])
    if body == camera or not moved:
        turn[row, body] = wp.mat33(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        shift[row, body] = zero
        return
    back = wp.transpose(turn_of(cam_then))
    place_now = wp.transform_get_translation(cam_now)
    place_then = wp.transform_get_translation(cam_then)
    body_turn = wp.identity(n=3, dtype=wp.float64)
    # Relative to the body first: no digits are lost far from the origin.
    offset = place_now - place_then
    if body < bodies:
        body_turn = turn_of(then[env, body]) * wp.transpose(turn_of(now[row, body]))
        offset = body_turn * (place_now - wp.transform_get_translation(now[row, body]))
        offset += wp.transform_get_translation(then[env, body]) - place_then
    d = back * body_turn * turn_of(cam_now) - wp.identity(n=3, dtype=wp.float64)
    turn[row, body] = wp.mat33(d)
    if body == bodies + 1:
        shift[row, body] = zero
    else:
        shift[row, body] = wp.vec3(back * offset)
