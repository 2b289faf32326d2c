"""Computes where a body is, and how fast it moves, at any instant between the sub-steps of /state.

The cubics are those of evis.geometry.interpolate, which works them out once for each gap between sub-steps; here they
are evaluated, for events have a time each.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Motion:
    """Holds the motion of E environments over G gaps between sub-steps, which follow one another in time."""

    start: wp.array(dtype=wp.int64)
    """[G + 1] when the gaps begin [ns], and when the last one ends."""
    place: wp.array(dtype=wp.int32)
    """[N] column of each body among the B that move, -1 for one that does not."""
    rest: wp.array2d(dtype=wp.transformd)
    """[E, N] pose of each body, for those that do not move."""
    pose: wp.array3d(dtype=wp.transformd)
    """[E, G, B] where each gap begins."""
    cubics: wp.array4d(dtype=wp.vec3d)
    """[E, G, B, 6] rise and end slopes of the position and of the rotation vector."""


@wp.struct
class State:
    """Holds the pose of a body, and its linear and angular velocity [m/s, rad/s], all in the world."""

    pose: wp.transformd
    velocity: wp.vec3d
    turning: wp.vec3d


@wp.func
def gap_at(motion: Motion, t: wp.int64):
    """Finds the gap that a time lies in, an end belonging to the gap before; times outside count to the nearest."""
    low = wp.int32(0)
    high = motion.start.shape[0] - 2
    while low < high:
        middle = (low + high) // 2
        if motion.start[middle + 1] < t:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def cubic(u: wp.float64, rise: wp.vec3d, slope0: wp.vec3d, slope1: wp.vec3d):
    """Computes the cubic from 0 to `rise` with the given end slopes."""
    one = wp.float64(1.0)
    low = u * u * (wp.float64(3.0) - wp.float64(2.0) * u)
    return low * rise + u * (one - u) * ((one - u) * slope0 - u * slope1)


@wp.func
def cubic_rate(u: wp.float64, rise: wp.vec3d, slope0: wp.vec3d, slope1: wp.vec3d):
    """Computes the cubic's derivative."""
    three, two = wp.float64(3.0), wp.float64(2.0)
    high = two * three * u * (wp.float64(1.0) - u)
    slow = wp.float64(1.0) - wp.float64(4.0) * u + three * u * u
    return high * rise + slow * slope0 + (three * u * u - two * u) * slope1


@wp.func
def turned_by(theta: wp.vec3d):
    """Computes the unit quaternion of a rotation vector."""
    half = wp.float64(0.5) * wp.length(theta)
    ratio = wp.float64(0.5)
    if half > wp.float64(1.0e-8):
        ratio = wp.float64(0.5) * wp.sin(half) / half
    v = ratio * theta
    return wp.quatd(v[0], v[1], v[2], wp.cos(half))


@wp.func
def turning_of(theta: wp.vec3d, rate: wp.vec3d):
    """Computes the angular velocity, in the world, of exp(theta) for d(theta)/dt = rate (Barfoot, 7.77)."""
    square = wp.dot(theta, theta)
    angle = wp.sqrt(square)
    one = wp.float64(1.0)
    a = wp.float64(0.5) - square / wp.float64(24.0)
    b = one / wp.float64(6.0) - square / wp.float64(120.0)
    if angle > wp.float64(1.0e-3):
        a = (one - wp.cos(angle)) / square
        b = (one - wp.sin(angle) / angle) / square
    across = wp.cross(theta, rate)
    return rate + a * across + b * wp.cross(theta, across)


@wp.func
def fraction(motion: Motion, gap: wp.int32, t: wp.int64):
    """Computes how far a time is in its gap, from 0 to 1."""
    start = motion.start[gap]
    u = wp.float64(t - start) / wp.float64(motion.start[gap + 1] - start)
    return wp.clamp(u, wp.float64(0.0), wp.float64(1.0))


@wp.func
def pose_of(motion: Motion, env: wp.int32, body: wp.int32, gap: wp.int32, u: wp.float64):
    """Computes the pose of a body at fraction u of a gap; body -1 is the static world."""
    found = wp.transform_identity(dtype=wp.float64)
    if body >= 0:
        m = motion.place[body]
        if m < 0:
            found = motion.rest[env, body]
        else:
            first = motion.pose[env, gap, m]
            c = motion.cubics[env, gap, m]
            p = wp.transform_get_translation(first) + cubic(u, c[0], c[1], c[2])
            q = turned_by(cubic(u, c[3], c[4], c[5])) * wp.transform_get_rotation(first)
            found = wp.transformd(p, q)
    return found


@wp.func
def state_of(motion: Motion, env: wp.int32, body: wp.int32, gap: wp.int32, u: wp.float64):
    """Computes pose and velocity of a body at fraction u of a gap; body -1 is the static world."""
    state = State()
    state.pose = pose_of(motion, env, body, gap, u)
    if body >= 0:
        m = motion.place[body]
        if m >= 0:
            seconds = wp.float64(1.0e-9) * wp.float64(motion.start[gap + 1] - motion.start[gap])
            c = motion.cubics[env, gap, m]
            state.velocity = cubic_rate(u, c[0], c[1], c[2]) / seconds
            theta = cubic(u, c[3], c[4], c[5])
            state.turning = turning_of(theta, cubic_rate(u, c[3], c[4], c[5])) / seconds
    return state
