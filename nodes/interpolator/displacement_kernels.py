"""Computes where a body's points seen at a sub-frame were in the camera at a keyframe, in float64."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class BodyMotion:
    """Holds how a body has moved since a keyframe: its point p, in the camera's frame, was at p + turn p + shift."""

    turn: wp.mat33
    shift: wp.vec3


# The twelve numbers of a motion are read as three times four at once: one by one they were a third of what the gather
# reads on a GPU.
TURN_AT = """
#if defined(__CUDA_ARCH__)
    const float4* part = reinterpret_cast<const float4*>(motions.data + at);
    const float4 a = __ldg(part);
    const float4 b = __ldg(part + 1);
    return wp::mat_t<3, 3, wp::float32>(a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, __ldg(part + 2).x);
#else
    return motions.data[at].turn;
#endif
"""


@wp.func_native(TURN_AT)
def turn_at(motions: wp.array2d(dtype=BodyMotion), at: wp.int32) -> wp.mat33:
    """Reads the turn of a motion by its place in memory."""
    ...


SHIFT_AT = """
#if defined(__CUDA_ARCH__)
    const float4 c = __ldg(reinterpret_cast<const float4*>(motions.data + at) + 2);
    return wp::vec_t<3, wp::float32>(c.y, c.z, c.w);
#else
    return motions.data[at].shift;
#endif
"""


@wp.func_native(SHIFT_AT)
def shift_at(motions: wp.array2d(dtype=BodyMotion), at: wp.int32) -> wp.vec3:
    """Reads the shift of a motion by its place in memory."""
    ...


@wp.func
def displaced(motions: wp.array2d(dtype=BodyMotion), at: int, point: wp.vec3):
    """Computes how far a point of a body has moved since a keyframe, in its camera frame [m]; at: place of the body in
    what `displace` has made in memory."""
    return turn_at(motions, at) * point + shift_at(motions, at)


@wp.func
def turned_back(motions: wp.array2d(dtype=BodyMotion), at: int, direction: wp.vec3):
    """Computes what a direction fixed to a body was in the camera frame of a keyframe; at: as of `displaced`."""
    return direction + turn_at(motions, at) * direction


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
    motions: wp.array2d(dtype=BodyMotion),
):
    """Computes D - 1 of the map D from a point in the camera frame now to the same body's point in the camera frame
    then.

    now [P E, N] and then [E, N]: poses of bodies in the world; environments repeat. motions [P E, N + 2]: entry N is
    the world and N + 1 the sky, which only turns. Exactly zero for what is where it was.
    """
    row, body = wp.tid()
    env = row % then.shape[0]
    bodies = now.shape[1]
    cam_now = now[row, camera]
    cam_then = then[env, camera]
    motion = BodyMotion()
    moved = not same(cam_now, cam_then)
    if body < bodies:
        moved = moved or not same(now[row, body], then[env, body])
    if body == camera or not moved:
        motions[row, body] = motion
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
    motion.turn = wp.mat33(d)
    if body != bodies + 1:
        motion.shift = wp.vec3(back * offset)
    motions[row, body] = motion
