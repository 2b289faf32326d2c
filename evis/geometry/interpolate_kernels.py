"""Computes `evis.geometry.interpolate.pose_at` in kernels, for poses of many environments at once."""

import warp as wp

wp.set_module_options({"enable_backward": False})

TURN = wp.constant(wp.float64(6.283185307179586))
TINY = wp.constant(wp.float64(1.0e-300))
ZERO, ONE, TWO, HALF = (wp.constant(wp.float64(value)) for value in (0.0, 1.0, 2.0, 0.5))


@wp.func
def rotation_vector(q: wp.quatd):
    """Computes the rotation vector of a unit quaternion, the shorter way round."""
    sign = wp.where(q[3] < ZERO, -ONE, ONE)
    v = sign * wp.vec3d(q[0], q[1], q[2])
    sine = wp.length(v)
    if sine < wp.float64(1.0e-12):
        return TWO * v
    return (TWO * wp.atan2(sine, sign * q[3]) / sine) * v


@wp.func
def rotation(r: wp.vec3d):
    """Computes the unit quaternion of a rotation vector."""
    half = HALF * wp.length(r)
    ratio = ONE
    if half >= wp.float64(1.0e-8):
        ratio = wp.sin(half) / half
    v = (HALF * ratio) * r
    return wp.quatd(v[0], v[1], v[2], wp.cos(half))


@wp.func
def unwrapped(phi: wp.vec3d, expected: wp.vec3d):
    """Gives, of all rotation vectors of one rotation, that nearest to `expected`."""
    angle = wp.length(phi)
    axis = phi / wp.max(angle, TINY)
    if angle < wp.float64(1.0e-9):
        axis = expected / wp.max(wp.length(expected), TINY)
    turns = wp.rint((wp.dot(axis, expected) - angle) / TURN)
    if turns == ZERO:
        return phi
    return (wp.where(angle < wp.float64(1.0e-9), ZERO, angle) + TURN * turns) * axis


@wp.func
def slope_of(phi: wp.vec3d, omega: wp.vec3d):
    """Computes the rate of the rotation vector phi at angular velocity omega, world frame (Barfoot, 7.77)."""
    angle = wp.length(phi)
    square = wp.max(angle * angle, TINY)
    if angle > wp.float64(1.5 * 3.141592653589793):
        # The map is singular at a full turn; the slope along phi is what a steady spin has.
        return (wp.dot(phi, omega) / square) * phi
    factor = wp.float64(1.0 / 12.0) + square / wp.float64(720.0)
    if angle >= wp.float64(1.0e-3):
        half = HALF * angle
        factor = (ONE - half / wp.tan(half)) / square
    across = wp.cross(phi, omega)
    return omega - HALF * across + factor * wp.cross(phi, across)


@wp.func
def cubic(u: wp.float64, rise: wp.vec3d, first: wp.vec3d, last: wp.vec3d):
    """Computes the cubic from 0 to `rise` with these end slopes per unit of u."""
    square = u * u
    ahead = (wp.float64(3.0) * square - TWO * square * u) * rise
    return ahead + (u * (ONE - u)) * ((ONE - u) * first - u * last)


@wp.func
def vector_at(values: wp.array(dtype=wp.float64), k: int):
    """Reads three numbers from place k on."""
    return wp.vec3d(values[k], values[k + 1], values[k + 2])


@wp.func
def rests(
    p0: wp.array(dtype=wp.float64),
    p1: wp.array(dtype=wp.float64),
    last: wp.array(dtype=wp.float64),
    v0: wp.array(dtype=wp.float64),
    v1: wp.array(dtype=wp.float64),
):
    """Tells whether a body is at its last pose at both ends, without velocity."""
    for k in range(7):
        if p0[k] != last[k] or p1[k] != last[k]:
            return False
    for k in range(6):
        if v0[k] != ZERO or v1[k] != ZERO:
            return False
    return True


@wp.kernel
def place_between(
    # in
    start: int,
    pose: wp.array4d(dtype=wp.float64),
    twist: wp.array4d(dtype=wp.float64),
    places: wp.array(dtype=int),
    columns: wp.array(dtype=int),
    left: wp.array(dtype=int),
    share: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    # out
    poses: wp.array4d(dtype=wp.float64),
):
    """Writes poses [T, E, M, 7] of an environment's bodies at T times.

    start: first environment. pose, twist: [E, S, B, ...] at the sub-steps. places: int [n], which of B; columns: of M.
    left, share, length: [T], the sub-step before each time, how much later it is, of the time to the next sub-step, and
    that time [s].
    """
    e = start + wp.tid()
    final = pose.shape[1] - 1
    for i in range(places.shape[0]):
        b = places[i]
        for k in range(left.shape[0]):
            before = left[k]
            after = wp.min(before + 1, final)
            p0 = pose[e, before, b]
            p1 = pose[e, after, b]
            v0 = twist[e, before, b]
            v1 = twist[e, after, b]
            found = poses[k, e, columns[i]]
            u = share[k]
            if u == ONE or rests(p0, p1, pose[e, final, b], v0, v1):
                for n in range(7):
                    found[n] = p1[n]
            elif u == ZERO:
                for n in range(7):
                    found[n] = p0[n]
            else:
                h = length[k]
                a = vector_at(p0, 0)
                at = a + cubic(u, vector_at(p1, 0) - a, h * vector_at(v0, 0), h * vector_at(v1, 0))
                q0 = wp.quatd(p0[3], p0[4], p0[5], p0[6])
                q1 = wp.quatd(p1[3], p1[4], p1[5], p1[6])
                back = wp.quatd(-p0[3], -p0[4], -p0[5], p0[6])
                spin0 = h * vector_at(v0, 3)
                spin1 = h * vector_at(v1, 3)
                phi = unwrapped(rotation_vector(q1 * back), HALF * (spin0 + spin1))
                q = rotation(cubic(u, phi, spin0, slope_of(phi, spin1))) * q0
                for n in range(3):
                    found[n] = at[n]
                for n in range(4):
                    found[3 + n] = q[n]
