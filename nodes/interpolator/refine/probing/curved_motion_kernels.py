"""Bounds how far moving things are off straight paths between two probes."""

import warp as wp

from nodes.interpolator.displacement_kernels import turn_of

wp.set_module_options({"enable_backward": False})


@wp.struct
class BoundingSpheres:
    """Holds balls about bodies: which of the bodies that move they are [C], their radius [m], and how far they are from
    the camera at least [E, C + 1] m; behind the last one stands the world, as a ball of that radius about the camera at
    the end of the gap, eye [E]."""

    mover: wp.array(dtype=int)
    radius: wp.array(dtype=wp.float64)
    away: wp.array2d(dtype=wp.float64)
    eye: wp.array(dtype=wp.transformd)


@wp.struct
class CurvatureLimits:
    """Holds what the camera may see, and from where on a way counts as curved.

    camera: its place among what moves, -1 where it stands still. whole: 1 for a camera that may see in all directions.
    sides: as of follow_boxes. even: angle [rad] up to which a way is straight. late: time [instants] up to which
    what is off it is only early or late.
    """

    camera: int
    whole: int
    sides: wp.vec4d
    even: wp.float64
    late: wp.float64


@wp.struct
class Seen:
    """Holds where a body is in the camera's frame."""

    turn: wp.mat33d
    place: wp.vec3d


@wp.func
def pose_at(start: wp.array2d(dtype=wp.transformd), poses: wp.array3d(dtype=wp.transformd), n: int, env: int, m: int):
    """Reads the pose of a mover at instant n, 0 being the start of the gap."""
    if n == 0:
        return start[env, m]
    return poses[n - 1, env, m]


@wp.func
def seen_at(
    balls: BoundingSpheres,
    camera: int,
    back: wp.mat33d,
    start: wp.array2d(dtype=wp.transformd),
    poses: wp.array3d(dtype=wp.transformd),
    n: int,
    env: int,
    j: int,
):
    """Computes where ball j is in the camera's frame at instant n. back: from the world to the frame of a camera that
    stands still."""
    at = balls.eye[env]
    turn_back = back
    if camera >= 0:
        at = pose_at(start, poses, n, env, camera)
        turn_back = wp.transpose(turn_of(at))
    pose = wp.transformd(wp.transform_get_translation(balls.eye[env]), wp.quatd(0.0, 0.0, 0.0, 1.0))
    if j < balls.mover.shape[0]:
        pose = pose_at(start, poses, n, env, balls.mover[j])
    seen = Seen()
    seen.turn = turn_back * turn_of(pose)
    seen.place = turn_back * (wp.transform_get_translation(pose) - wp.transform_get_translation(at))
    return seen


@wp.func
def angle_of(turn: wp.mat33d, place: wp.vec3d, radius: wp.float64, away: wp.float64):
    """Gives the angle at which the camera sees a ball's points move, about: for a difference of two places of it."""
    half = wp.float64(0.5)
    return (wp.length(place) + radius * wp.sqrt(half * wp.ddot(turn, turn))) / away


@wp.func
def in_view(seen: Seen, radius: wp.float64, sides: wp.vec4d):
    """Tells whether a ball reaches into the image. sides: as of follow_boxes."""
    p = seen.place
    if p[2] + radius <= wp.float64(0.0):
        return False
    for axis in range(2):
        for end in range(2):
            side = sides[2 * axis + end]
            sign = wp.where(end == 0, wp.float64(1.0), wp.float64(-1.0))
            size = wp.sqrt(wp.float64(1.0) + side * side)
            if sign * (p[axis] - side * p[2]) + radius * size < wp.float64(0.0):
                return False
    return True


@wp.func
def is_curved(
    balls: BoundingSpheres,
    limits: CurvatureLimits,
    start: wp.array2d(dtype=wp.transformd),
    poses: wp.array3d(dtype=wp.transformd),
    env: int,
    j: int,
    radius: wp.float64,
    first: int,
    step: int,
):
    """Tells whether ball j is in the image and off a straight way, from instant `first` to the one `step` later."""
    back = wp.transpose(turn_of(balls.eye[env]))
    a = seen_at(balls, limits.camera, back, start, poses, first, env, j)
    b = seen_at(balls, limits.camera, back, start, poses, first + step, env, j)
    shown = wp.bool(limits.whole == 1 or j == balls.mover.shape[0])
    away = balls.away[env, j]
    before = a
    path = wp.float64(0.0)
    off = wp.float64(0.0)
    for i in range(1, step + 1):
        m = b
        if i < step:
            m = seen_at(balls, limits.camera, back, start, poses, first + i, env, j)
        shown = shown or in_view(m, radius, limits.sides)
        path += angle_of(m.turn - before.turn, m.place - before.place, radius, away)
        g = wp.float64(i) / wp.float64(step)
        turn = m.turn - a.turn - g * (b.turn - a.turn)
        place = m.place - a.place - g * (b.place - a.place)
        off = wp.max(off, angle_of(turn, place, radius, away))
        before = m
    return shown and off > limits.even and off * wp.float64(step) > limits.late * path


@wp.kernel
def find_curved_motion(
    # in
    balls: BoundingSpheres,
    limits: CurvatureLimits,
    coarse: int,
    least: int,
    most: int,
    start: wp.array2d(dtype=wp.transformd),
    poses: wp.array3d(dtype=wp.transformd),
    # out
    needed: wp.array(dtype=int),
):
    """Finds into how many parts a coarse interval is to be divided, least or more, so that what is in the image goes a
    straight way in each: needed [E], 2 most where `most` are too few.

    start, poses: of what moves at the start of the gap [E, M] and at its instants [n, E, M].
    """
    env, j = wp.tid()
    world = j == balls.mover.shape[0]
    if world and limits.camera < 0:
        return
    radius = balls.away[env, j]
    if not world:
        radius = balls.radius[j]
    count = poses.shape[0]
    each = wp.int32(least)
    n = wp.int32(0)
    while n < count and each <= most:
        step = count // (coarse * each)
        if step > 1 and is_curved(balls, limits, start, poses, env, j, radius, n, step):
            # What comes before goes straight in shorter parts too.
            each = 2 * each
        else:
            n += step
    wp.atomic_max(needed, env, each)
