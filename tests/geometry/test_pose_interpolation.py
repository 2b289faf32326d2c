"""Poses between sub-steps: exact for steady motion, of fourth order for any other."""

import numpy as np
import pytest

from evis.geometry import interpolate, se3

MS = 1_000_000


def steady(omega, times):
    """A body with constant velocity and angular velocity: poses and twists [S, 1, .]."""
    t = np.asarray(times) * 1e-9
    start = se3.normalize(np.array([0.1, 0.2, -0.4, 0.8]))
    pose = se3.make_pose(np.outer(t, [1.0, -2.0, 3.0]), se3.multiply(se3.exp(np.outer(t, omega)), start))
    twist = np.tile(np.concatenate(([1.0, -2.0, 3.0], omega)), (len(t), 1))
    return pose[:, None], twist[:, None]


def distance(a, b):
    angle = np.linalg.norm(se3.log(se3.multiply(a[..., 3:], se3.conjugate(b[..., 3:]))), axis=-1)
    return max(np.abs(a[..., :3] - b[..., :3]).max(), angle.max())


@pytest.mark.parametrize("speed", [0.0, 1e-6, 50.0, 1000.0, 3000.0, 5000.0, 12000.0])
def test_exact_at_constant_angular_velocity(speed):
    """Also where a body turns more than half a turn, and more than a whole one, per millisecond."""
    omega = speed * np.array([1.0, -2.0, 2.0]) / 3
    times = np.arange(4) * MS
    wanted = np.array([0, 1, 400_000, 1_234_567, 2_999_999, 3 * MS])
    pose, twist = steady(omega, wanted)
    found = interpolate.pose_at(wanted, times, *steady(omega, times))
    assert distance(found, pose) < 1e-12  # rounding of an angle of 36 rad
    assert np.abs(interpolate.twist_at(wanted, times, *steady(omega, times)) - twist).max() < 1e-9 * max(speed, 1)


def test_knots_are_returned_to_the_last_bit():
    """A time that has a pose of its own gets that pose, sign and all."""
    times = np.arange(5) * MS
    pose, twist = steady(np.array([3.0, 4.0, 100.0]), times)
    pose[2, :, 3:] *= -1
    assert np.array_equal(interpolate.pose_at(times, times, pose, twist), pose)
    assert np.array_equal(interpolate.twist_at(times, times, pose, twist), twist)
    assert interpolate.pose_at(2 * MS, times, pose, twist).shape == (1, 7)


def tumbling(times):
    """A rotation whose axis and rate both change, with its exact angular velocity, and a curved path."""
    t = np.asarray(times)[:, None] * 1e-9
    a, b = 40 * t + 300 * t**2, 9 * np.sin(30 * t)
    qa = se3.exp(a * np.array([0.0, 0.0, 1.0]))
    qb = se3.exp(b * np.array([1.0, 0.0, 0.0]))
    omega = (40 + 600 * t) * np.array([0.0, 0.0, 1.0]) + se3.rotate(
        qa, 270 * np.cos(30 * t) * np.array([1.0, 0.0, 0.0])
    )
    position = np.concatenate((np.sin(50 * t), t**2, np.exp(5 * t)), axis=-1)
    velocity = np.concatenate((50 * np.cos(50 * t), 2 * t, 5 * np.exp(5 * t)), axis=-1)
    return se3.make_pose(position, se3.multiply(qa, qb))[:, None], np.concatenate((velocity, omega), -1)[:, None]


def test_fourth_order():
    """Halving the sub-step divides the error by 16 (within a factor that the next order explains)."""
    wanted = np.arange(0, 40 * MS, 37_000)
    errors = []
    for step in (2 * MS, MS, MS // 2):
        times = np.arange(0, 40 * MS + step, step)
        errors.append(distance(interpolate.pose_at(wanted, times, *tumbling(times)), tumbling(wanted)[0]))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 13) & (ratios < 19)), errors


def test_twist_is_the_derivative_of_the_pose():
    """Central differences of pose_at, 1 us apart, in the middle of a sub-step."""
    times = np.arange(0, 10 * MS, MS)
    state = tumbling(times)
    t = np.array([3_456_789])
    h = 1000
    later, before = (interpolate.pose_at(t + d, times, *state)[0, 0] for d in (h, -h))
    v = (later[:3] - before[:3]) / (2e-9 * h)
    omega = se3.log(se3.multiply(later[3:], se3.conjugate(before[3:]))) / (2e-9 * h)
    # truncation: third derivative (1e6 1/s^3 for the fast turn) times h^2 / 6; rounding: 1e-16 / h
    assert np.abs(interpolate.twist_at(t, times, *state)[0, 0] - np.concatenate((v, omega))).max() < 1e-4


def test_part_of_a_curve_is_the_curve():
    """From poses and twists taken off the curve itself, positions between come out the same (a cubic is a cubic)."""
    times = np.array([0, MS])
    state = tumbling(times)
    knots = np.array([200_000, MS])
    again = (interpolate.pose_at(knots, times, *state), interpolate.twist_at(knots, times, *state))
    t = np.array([350_000, 800_001])
    a, b = interpolate.pose_at(t, times, *state), interpolate.pose_at(t, knots, *again)
    assert np.abs(a[..., :3] - b[..., :3]).max() < 1e-15
    assert distance(a, b) < 1e-6  # rotations: cubic in different tangent spaces, they agree to fourth order


def test_leading_axes_are_kept():
    """[E, S, N, .] gives [E, T, N, .]."""
    times = np.arange(3) * MS
    pose, twist = (np.tile(a, (2, 1, 4, 1)) for a in steady(np.array([1.0, 0, 0]), times))
    assert interpolate.pose_at(np.array([5, 6, 7]), times, pose, twist).shape == (2, 3, 4, 7)


def test_a_time_outside_is_refused():
    """The error names both ranges."""
    times = np.arange(3) * MS
    with pytest.raises(ValueError, match="from 0 to 2000000 ns, asked for 2000001"):
        interpolate.pose_at(2 * MS + 1, times, *steady(np.zeros(3), times))
    one = times[:1]
    assert interpolate.pose_at(0, one, *steady(np.ones(3), one)).shape == (1, 7)
