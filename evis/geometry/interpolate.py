"""Interpolates poses between the sub-steps of /state.

Position: the cubic Hermite of positions and velocities. Rotation: R(t) = exp(theta(t)) R0, where theta is the cubic
Hermite in rotation-vector space whose end slopes give the angular velocities at both ends; at constant omega theta is
linear and the result exact. Both are of fourth order in the length of the sub-step.
"""

from __future__ import annotations

import numpy as np

from evis.geometry import se3

NS = 1e-9
"""Seconds per nanosecond."""


def pose_at(t: np.ndarray | int, times: np.ndarray, poses: np.ndarray, twists: np.ndarray) -> np.ndarray:
    """Computes the poses at times t.

    t: int64 [T] or one time, ns, within [times[0], times[-1]]. times: int64 [S], ascending. poses [..., S, N, 7] and
    twists [..., S, N, 6] at those times, world frame. Returns float64 [..., T, N, 7], without the T axis for one time.
    Raises ValueError for a time outside.
    """
    return state_at(t, times, poses, twists)[0]


def twist_at(t: np.ndarray | int, times: np.ndarray, poses: np.ndarray, twists: np.ndarray) -> np.ndarray:
    """Computes the derivative of `pose_at`: twists float64 [..., T, N, 6], world frame; arguments and errors as
    there.
    """
    return state_at(t, times, poses, twists)[1]


def state_at(
    t: np.ndarray | int, times: np.ndarray, poses: np.ndarray, twists: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Computes both `pose_at` and `twist_at`, for the price of one."""
    times, poses, twists = np.asarray(times, np.int64), np.asarray(poses), np.asarray(twists)
    wanted = np.atleast_1d(np.asarray(t, np.int64))
    left = step_before(wanted, times)
    if len(times) == 1:
        pose, twist = np.repeat(poses, len(wanted), axis=-3), np.repeat(twists, len(wanted), axis=-3)
    else:
        gap = times[left + 1] - times[left]
        u = ((wanted - times[left]) / gap)[:, None, None]
        h = (gap * NS)[:, None, None]
        p0, p1, v0, v1 = (np.take(a, i, axis=-3) for a in (poses, twists) for i in (left, left + 1))
        pose, twist = _between(u, h, p0, p1, v0, v1)
        # At a knot the answer is the knot itself, to the last bit, whatever sign its quaternion has.
        first, last = (wanted == times[left])[:, None, None], (wanted == times[left + 1])[:, None, None]
        pose = np.where(first, p0, np.where(last, p1, pose))
        twist = np.where(first, v0, np.where(last, v1, twist))
    return (pose, twist) if np.ndim(t) else (pose[..., 0, :, :], twist[..., 0, :, :])


def step_before(t: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Finds which of `times` int64 [S] is the last one not after each t int64 [T], but for the very last one.

    Raises ValueError for a time outside.
    """
    if t.size and (t.min() < times[0] or t.max() > times[-1]):
        raise ValueError(f"poses are known from {times[0]} to {times[-1]} ns, asked for {t.min()} to {t.max()} ns")
    return np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0))


def gaps(times: np.ndarray, poses: np.ndarray, twists: np.ndarray) -> np.ndarray:
    """Computes the cubics that lead from each time to the next, for whoever evaluates them elsewhere.

    Args as of `pose_at`. Returns float64 [..., S - 1, N, 18]: rise and both end slopes of the position, then of the
    rotation vector theta, each a vector, slopes per unit of u in [0, 1].
    """
    h = (np.diff(np.asarray(times, np.int64)) * NS)[:, None, None]
    a, b = slice(None, -1), slice(1, None)
    return np.concatenate(
        _ends(h, poses[..., a, :, :], poses[..., b, :, :], twists[..., a, :, :], twists[..., b, :, :]), -1
    )


def _ends(h: np.ndarray, p0: np.ndarray, p1: np.ndarray, v0: np.ndarray, v1: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rise and end slopes of position and rotation vector over gaps of h seconds."""
    spin0, spin1 = h * v0[..., 3:], h * v1[..., 3:]
    phi = se3.log(se3.multiply(p1[..., 3:], se3.conjugate(p0[..., 3:])))
    phi = _unwrap(phi, 0.5 * (spin0 + spin1))
    shift = p1[..., :3] - p0[..., :3], h * v0[..., :3], h * v1[..., :3]
    return (*shift, phi, spin0, _inverse_left_jacobian(phi, spin1))


def _between(
    u: np.ndarray, h: np.ndarray, p0: np.ndarray, p1: np.ndarray, v0: np.ndarray, v1: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pose and twist at the fraction u of gaps of h seconds, from the poses and twists at both ends."""
    ends = _ends(h, p0, p1, v0, v1)
    position, velocity = _hermite(u, *ends[:3])
    theta, slope = _hermite(u, *ends[3:])
    pose = se3.make_pose(p0[..., :3] + position, se3.multiply(se3.exp(theta), p0[..., 3:]))
    return pose, np.concatenate((velocity, _left_jacobian(theta, slope)), axis=-1) / h


def _hermite(u: np.ndarray, rise: np.ndarray, slope0: np.ndarray, slope1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cubic from 0 to `rise` with the given end slopes (per unit of u), and its derivative."""
    square = u * u
    value = (3 * square - 2 * square * u) * rise + u * (1 - u) * ((1 - u) * slope0 - u * slope1)
    slope = 6 * u * (1 - u) * rise + (1 - 4 * u + 3 * square) * slope0 + (3 * square - 2 * u) * slope1
    return value, slope


def _unwrap(phi: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Of all rotation vectors of one rotation, that nearest to `expected`: a gap may hold more than half a turn."""
    angle = np.linalg.norm(phi, axis=-1, keepdims=True)
    # Where phi itself vanishes its axis is that of the expected turn.
    length = np.linalg.norm(expected, axis=-1, keepdims=True)
    tiny = angle < 1e-9
    axis = np.where(tiny, expected / np.maximum(length, 1e-300), phi / np.maximum(angle, 1e-300))
    turns = np.round((np.sum(axis * expected, axis=-1, keepdims=True) - angle) / (2 * np.pi))
    return np.where(turns == 0.0, phi, axis * (np.where(tiny, 0.0, angle) + 2 * np.pi * turns))


def _inverse_left_jacobian(phi: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """d(theta)/dt at theta = phi for angular velocity omega in the world frame (Barfoot, State Estimation, 7.77)."""
    angle = np.linalg.norm(phi, axis=-1, keepdims=True)
    small = angle < 1e-3
    half = 0.5 * np.where(small, 1.0, angle)
    square = np.maximum(angle * angle, 1e-300)
    factor = np.where(small, 1 / 12 + square / 720, (1 - half / np.tan(half)) / square)
    # The map is singular at a full turn; past three quarters of one the slope along phi alone is kept, which is what
    # a fast steady spin has.
    far = angle > 1.5 * np.pi
    cross = se3.cross(phi, omega)
    full = omega - 0.5 * cross + np.where(far, 0.0, factor) * se3.cross(phi, cross)
    along = phi * np.sum(phi * omega, axis=-1, keepdims=True) / square
    return np.where(far, along, full)


def _left_jacobian(theta: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Angular velocity in the world frame of exp(theta(t)) for d(theta)/dt = rate (Barfoot, 7.77)."""
    angle = np.linalg.norm(theta, axis=-1, keepdims=True)
    square = np.maximum(angle * angle, 1e-300)
    small = angle < 1e-3
    a = np.where(small, 0.5 - angle * angle / 24, (1 - np.cos(angle)) / square)
    b = np.where(small, 1 / 6 - angle * angle / 120, (1 - np.sinc(angle / np.pi)) / square)
    cross = se3.cross(theta, rate)
    return rate + a * cross + b * se3.cross(theta, cross)
