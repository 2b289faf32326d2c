"""Writes what MuJoCo has recorded of environments into their course, in float64 on a CPU.

The arithmetic is that of states.twist_and_pose, to the bit: single products and sums, which no compiler joins.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Recorded:
    """Holds the states of n environments in S steps, as MuJoCo has them.

    xpos, xquat, cvel, com: fields of all bodies, [n, S, bodies, ...] before each step where `late` is 1, otherwise
    after it. now_xpos, ...: after the last step. qpos, qvel: [n, S, ...] after each.
    """

    xpos: wp.array4d(dtype=wp.float64)
    xquat: wp.array4d(dtype=wp.float64)
    cvel: wp.array4d(dtype=wp.float64)
    com: wp.array4d(dtype=wp.float64)
    now_xpos: wp.array3d(dtype=wp.float64)
    now_xquat: wp.array3d(dtype=wp.float64)
    now_cvel: wp.array3d(dtype=wp.float64)
    now_com: wp.array3d(dtype=wp.float64)
    qpos: wp.array3d(dtype=wp.float64)
    qvel: wp.array3d(dtype=wp.float64)
    late: int


@wp.struct
class Written:
    """Holds the arrays that `write_course` writes of m environments, beside their course.

    state_pose, state_twist: [m, 2, bodies without the world, ...] after the last two steps. speed: [m], greatest speed
    of a point of a body, not finite where anything is not. fastest: [m], greatest component of a velocity before the
    last step.
    """

    state_pose: wp.array4d(dtype=wp.float64)
    state_twist: wp.array4d(dtype=wp.float64)
    speed: wp.array(dtype=wp.float64)
    fastest: wp.array(dtype=wp.float64)


@wp.func
def cross_part(a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64):
    """Computes a b - c d with both products rounded."""
    left = a * b
    right = c * d
    return left - right


@wp.func
def write_body(
    xpos: Any,
    xquat: Any,
    cvel: Any,
    com: Any,
    r: int,
    pose: wp.array(dtype=wp.float64),
    twist: wp.array(dtype=wp.float64),
):
    """Writes pose and twist of a body; com: of all bodies, r = the body at the top of its tree."""
    for k in range(3):
        pose[k] = xpos[k]
        twist[3 + k] = cvel[k]
    for k in range(4):
        pose[3 + k] = xquat[(k + 1) % 4]
    ax = xpos[0] - com[r, 0]
    ay = xpos[1] - com[r, 1]
    az = xpos[2] - com[r, 2]
    twist[0] = cvel[3] + cross_part(cvel[1], az, cvel[2], ay)
    twist[1] = cvel[4] + cross_part(cvel[2], ax, cvel[0], az)
    twist[2] = cvel[5] + cross_part(cvel[0], ay, cvel[1], ax)


@wp.kernel
def write_course(
    # in
    start: int,
    places: wp.array(dtype=int),
    envs: wp.array(dtype=int),
    root: wp.array(dtype=int),
    column: wp.array(dtype=int),
    reach: wp.array(dtype=wp.float64),
    recorded: Recorded,
    # out
    written: Written,
    # in
    first: int,
    # out
    poses: wp.array4d(dtype=wp.float64),
    twists: wp.array4d(dtype=wp.float64),
):
    """Writes the course of environments `start` and on of those listed.

    places: their rows in `recorded`; envs: in `poses`. root, column, reach: of each body, the top of its tree, its
    place among those that may move (-1 = never moves), the distance [m] of its farthest point. poses, twists: [E, rows,
    M, ...] of bodies that may move, from row `first` on, but for the last step.
    """
    j = start + wp.tid()
    n = places[j]
    env = envs[j]
    steps = recorded.xpos.shape[1]
    total = wp.float64(0.0)
    speed = wp.float64(0.0)
    fastest = wp.float64(0.0)
    for s in range(steps):
        for k in range(recorded.qpos.shape[2]):
            total += recorded.qpos[n, s, k]
        for k in range(recorded.qvel.shape[2]):
            total += recorded.qvel[n, s, k]
        for b in range(1, recorded.xpos.shape[2]):
            # The state after the last two steps is kept; scratch for the others.
            slot = wp.where(s == steps - 2, 0, 1)
            pose = written.state_pose[j, slot, b - 1]
            twist = written.state_twist[j, slot, b - 1]
            i = s + recorded.late
            if i < steps:
                write_body(
                    recorded.xpos[n, i, b], recorded.xquat[n, i, b], recorded.cvel[n, i, b], recorded.com[n, i],
                    root[b], pose, twist,
                )  # fmt: skip
            else:
                write_body(
                    recorded.now_xpos[n, b], recorded.now_xquat[n, b], recorded.now_cvel[n, b], recorded.now_com[n],
                    root[b], pose, twist,
                )  # fmt: skip
            v = twist[0] * twist[0] + twist[1] * twist[1] + twist[2] * twist[2]
            omega = twist[3] * twist[3] + twist[4] * twist[4] + twist[5] * twist[5]
            point = wp.sqrt(v) + wp.sqrt(omega) * reach[b]
            total += point
            speed = wp.max(speed, point)
            if s < steps - 1:
                for k in range(6):
                    fastest = wp.max(fastest, wp.abs(twist[k]))
                m = column[b]
                if m >= 0:
                    row = first + s
                    for k in range(7):
                        poses[env, row, m, k] = pose[k]
                    for k in range(6):
                        twists[env, row, m, k] = twist[k]
    written.fastest[j] = fastest
    # A sum is finite only if everything in it is.
    written.speed[j] = wp.where(wp.isfinite(total), speed, total)
