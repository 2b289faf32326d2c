"""Computes with quaternions and poses, vectorised over leading axes, float64.

A quaternion is [..., 4], x y z w (Hamilton product, unit norm unless said otherwise); q and -q are the same rotation. A
pose is [..., 7]: position [m], then the quaternion, and maps points of its own frame to the parent's. A rotation vector
is [..., 3]: axis times angle [rad].
"""

from __future__ import annotations

import numpy as np

IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
"""The pose that changes nothing."""
Z_UP = np.array([0.0, 0.0, 1.0])


def from_mujoco(wxyz: np.ndarray) -> np.ndarray:
    """Reorders MuJoCo's w x y z quaternions to x y z w. The one place where the order is changed."""
    return np.asarray(wxyz, np.float64)[..., [1, 2, 3, 0]]


def to_mujoco(xyzw: np.ndarray) -> np.ndarray:
    """Reorders x y z w quaternions to MuJoCo's w x y z."""
    return np.asarray(xyzw, np.float64)[..., [3, 0, 1, 2]]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Computes the cross product of [..., 3] and [..., 3]; several times faster than numpy.cross on small arrays."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=-1)


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Computes the product of quaternions: first the rotation b, then a."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    ax, ay, az, aw = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bx, by, bz, bw = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return np.stack(
        (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ),
        axis=-1,
    )


def conjugate(q: np.ndarray) -> np.ndarray:
    """Computes the inverse rotation of a unit quaternion."""
    return np.asarray(q, np.float64) * np.array([-1.0, -1.0, -1.0, 1.0])


def normalize(q: np.ndarray) -> np.ndarray:
    """Scales quaternions to unit norm. Raises ValueError for a zero or non-finite quaternion."""
    q = np.asarray(q, np.float64)
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    if not np.all(np.isfinite(norm)) or np.any(norm == 0.0):
        raise ValueError("a quaternion is zero or not finite, so it is no rotation")
    return q / norm


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Computes the vectors [..., 3] turned by unit quaternions: v + 2 w (u x v) + 2 u x (u x v)."""
    q, v = np.asarray(q, np.float64), np.asarray(v, np.float64)
    u, w = q[..., :3], q[..., 3:]
    twice = 2.0 * cross(u, v)
    return v + w * twice + cross(u, twice)


def to_matrix(q: np.ndarray) -> np.ndarray:
    """Computes the rotation matrices [..., 3, 3] of unit quaternions."""
    q = np.asarray(q, np.float64)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(m: np.ndarray) -> np.ndarray:
    """Computes the unit quaternions (w >= 0) of rotation matrices [..., 3, 3].

    Divides by the largest of the four components, so it is accurate at every angle (Shepperd, 1978).
    """
    m = np.asarray(m, np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    # Row k is 4 q_k times the whole quaternion.
    rows = np.stack(
        [
            np.stack((1 + xx - yy - zz, xy, xz, wx), axis=-1),
            np.stack((xy, 1 - xx + yy - zz, yz, wy), axis=-1),
            np.stack((xz, yz, 1 - xx - yy + zz, wz), axis=-1),
            np.stack((wx, wy, wz, 1 + xx + yy + zz), axis=-1),
        ],
        axis=-2,
    )
    largest = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(rows, largest[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., 3:] < 0.0, -q, q)


def exp(rotation_vector: np.ndarray) -> np.ndarray:
    """Computes the unit quaternions of rotation vectors; exact to rounding at any angle."""
    r = np.asarray(rotation_vector, np.float64)
    half = 0.5 * np.linalg.norm(r, axis=-1, keepdims=True)
    small = half < 1e-8  # there sin(half) / half is 1 to rounding
    ratio = np.where(small, 1.0, np.sin(half) / np.where(small, 1.0, half))
    return np.concatenate((0.5 * ratio * r, np.cos(half)), axis=-1)


def log(q: np.ndarray) -> np.ndarray:
    """Computes the rotation vectors of unit quaternions, the shorter way round (angle <= pi)."""
    q = np.asarray(q, np.float64)
    q = np.where(q[..., 3:] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    small = sine < 1e-12  # there angle / sine = 2 to rounding
    return q[..., :3] * np.where(small, 2.0, angle(q)[..., None] / np.where(small, 1.0, sine))


def angle(q: np.ndarray) -> np.ndarray:
    """Computes the angles [...] of unit quaternions [rad], the shorter way round (angle <= pi)."""
    q = np.asarray(q, np.float64)
    return np.asarray(2 * np.arctan2(np.linalg.norm(q[..., :3], axis=-1), np.abs(q[..., 3])))


def make_pose(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Returns the poses [..., 7] of positions and quaternions, broadcast against each other."""
    p, q = np.asarray(position, np.float64), np.asarray(quaternion, np.float64)
    lead = np.broadcast_shapes(p.shape[:-1], q.shape[:-1])
    return np.concatenate((np.broadcast_to(p, (*lead, 3)), np.broadcast_to(q, (*lead, 4))), axis=-1)


def compose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Composes pose a of a frame in the world, pose b given in that frame: b in the world."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    return make_pose(a[..., :3] + rotate(a[..., 3:], b[..., :3]), multiply(a[..., 3:], b[..., 3:]))


def inverse(pose: np.ndarray) -> np.ndarray:
    """Computes the pose that undoes this one."""
    pose = np.asarray(pose, np.float64)
    q = conjugate(pose[..., 3:])
    return make_pose(-rotate(q, pose[..., :3]), q)


def transform(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Computes the points [..., 3] of the pose's own frame in its parent's frame."""
    pose = np.asarray(pose, np.float64)
    return pose[..., :3] + rotate(pose[..., 3:], points)


def compose_twist(parent_pose: np.ndarray, parent_twist: np.ndarray, pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Computes the world twist [..., 6] (v, omega) of a frame that moves with `twist` in a parent that moves itself.

    pose, twist: of the frame in the parent; parent_*: of the parent in the world.
    """
    q, omega = parent_pose[..., 3:], parent_twist[..., 3:]
    v = parent_twist[..., :3] + cross(omega, rotate(q, pose[..., :3])) + rotate(q, twist[..., :3])
    return np.concatenate((v, omega + rotate(q, twist[..., 3:])), axis=-1)


def compose_acceleration(
    parent_pose: np.ndarray, parent_twist: np.ndarray, parent_acceleration: np.ndarray, pose: np.ndarray,
    twist: np.ndarray, acceleration: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Computes the world acceleration [..., 6] (a, alpha) of a frame that moves in a parent that moves itself.

    pose, twist, acceleration: of the frame in the parent; parent_*: of the parent in the world. The derivative of
    `compose_twist`.
    """
    q, omega, alpha = parent_pose[..., 3:], parent_twist[..., 3:], parent_acceleration[..., 3:]
    arm, velocity, spin = (rotate(q, a) for a in (pose[..., :3], twist[..., :3], twist[..., 3:]))
    linear = parent_acceleration[..., :3] + cross(alpha, arm) + cross(omega, cross(omega, arm))
    linear = linear + 2.0 * cross(omega, velocity) + rotate(q, acceleration[..., :3])
    return np.concatenate((linear, alpha + rotate(q, acceleration[..., 3:]) + cross(omega, spin)), axis=-1)


def look_at(eye: np.ndarray, target: np.ndarray, up: np.ndarray = Z_UP) -> np.ndarray:
    """Computes the pose of a camera at `eye` that looks (+z) at `target`, with `up` upwards in the image (-y).

    Raises ValueError where the direction is zero or along `up`.
    """
    forward = np.asarray(target, np.float64) - np.asarray(eye, np.float64)
    right = cross(forward, np.asarray(up, np.float64))
    length, width = np.linalg.norm(forward), np.linalg.norm(right)
    if length == 0.0:
        raise ValueError("the camera looks at the point where it stands; move position or look_at")
    if width < 1e-9 * length:
        raise ValueError("the camera looks along 'up'; give another 'up'")
    z, x = forward / length, right / width
    return make_pose(np.asarray(eye, np.float64), from_matrix(np.stack((x, cross(z, x), z), axis=-1)))
