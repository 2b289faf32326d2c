"""Places what is mounted on bodies of environments, in float64 on a CPU.

The arithmetic is that of se3.compose and se3.compose_twist, to the bit: single products and sums, which no compiler
joins. So what is mounted is in an interval where it is at a start, which numpy places.
"""

import warp as wp

from nodes.physics.dynamics.course.course_kernels import cross_part

wp.set_module_options({"enable_backward": False})

ZERO, TWO = (wp.constant(wp.float64(value)) for value in (0.0, 2.0))


@wp.func
def crossed(a: wp.vec3d, b: wp.vec3d):
    """Computes the cross product, its products rounded."""
    return wp.vec3d(
        cross_part(a[1], b[2], a[2], b[1]), cross_part(a[2], b[0], a[0], b[2]), cross_part(a[0], b[1], a[1], b[0])
    )


@wp.func
def plus(a: wp.vec3d, b: wp.vec3d):
    """Adds b to a."""
    return wp.vec3d(a[0] + b[0], a[1] + b[1], a[2] + b[2])


@wp.func
def times(k: wp.float64, a: wp.vec3d):
    """Multiplies a by k."""
    return wp.vec3d(k * a[0], k * a[1], k * a[2])


@wp.func
def sum_of(a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64):
    """Adds up four products, in this order."""
    return ((a + b) + c) + d


@wp.kernel
def place_mounted(
    # in
    start: int,
    below: wp.array(dtype=int),
    above: wp.array(dtype=int),
    offsets: wp.array2d(dtype=wp.float64),
    # in, out
    poses: wp.array4d(dtype=wp.float64),
    twists: wp.array4d(dtype=wp.float64),
):
    """Writes poses and twists of the bodies `below`, in this order, which are fixed on `above` at `offsets` [n, 7].

    start: first environment. poses, twists: [E, S, M, ...]; below, above: which of M.
    """
    e = start + wp.tid()
    for s in range(poses.shape[1]):
        for n in range(below.shape[0]):
            p = poses[e, s, above[n]]
            t = twists[e, s, above[n]]
            o = offsets[n]
            u = wp.vec3d(p[3], p[4], p[5])
            w = p[6]
            arm = wp.vec3d(o[0], o[1], o[2])
            twice = times(TWO, crossed(u, arm))
            turned = plus(plus(arm, times(w, twice)), crossed(u, twice))
            drift = crossed(wp.vec3d(t[3], t[4], t[5]), turned)
            pose = poses[e, s, below[n]]
            twist = twists[e, s, below[n]]
            for k in range(3):
                pose[k] = p[k] + turned[k]
                # numpy adds the velocity in the frame above, which is none.
                twist[k] = (t[k] + drift[k]) + ZERO
                twist[3 + k] = t[3 + k] + ZERO
            x = o[3]
            y = o[4]
            z = o[5]
            v = o[6]
            pose[3] = sum_of(w * x, u[0] * v, u[1] * z, -(u[2] * y))
            pose[4] = sum_of(w * y, -(u[0] * z), u[1] * v, u[2] * x)
            pose[5] = sum_of(w * z, u[0] * y, -(u[1] * x), u[2] * v)
            pose[6] = sum_of(w * v, -(u[0] * x), -(u[1] * y), -(u[2] * z))
