"""Quaternion and pose algebra against scipy's Rotation and 4x4 matrices."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evis.geometry import se3

TOLERANCE = 4e-15
"""A handful of float64 roundings of numbers near one."""


def random_quaternions(count: int, seed: int = 0) -> np.ndarray:
    return se3.normalize(np.random.default_rng(seed).normal(size=(count, 4)))


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    return se3.make_pose(np.random.default_rng(seed + 1).normal(size=(count, 3)), random_quaternions(count, seed))


def matrix(pose: np.ndarray) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return result


def same_rotation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.minimum(np.abs(a - b).max(-1), np.abs(a + b).max(-1))


def test_product_matrix_and_rotation_agree_with_scipy():
    """multiply, to_matrix, from_matrix and rotate on random rotations."""
    a, b = random_quaternions(200, 1), random_quaternions(200, 2)
    v = np.random.default_rng(3).normal(size=(200, 3))
    scipy = Rotation.from_quat(a)
    assert same_rotation(se3.multiply(a, b), (scipy * Rotation.from_quat(b)).as_quat()).max() < TOLERANCE
    assert np.abs(se3.to_matrix(a) - scipy.as_matrix()).max() < TOLERANCE
    assert same_rotation(se3.from_matrix(scipy.as_matrix()), a).max() < TOLERANCE
    assert np.abs(se3.rotate(a, v) - scipy.apply(v)).max() < 2e-14


@pytest.mark.parametrize("angle", [0.0, 1e-13, 1e-9, 1e-4, 1.0, np.pi - 1e-9, np.pi])
def test_exp_and_log_at_every_angle(angle):
    """Tiny angles and half turns are where formulas with a division go wrong."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    q = se3.exp(angle * axis)
    assert same_rotation(q, Rotation.from_rotvec(angle * axis).as_quat()) < TOLERANCE
    assert np.abs(np.abs(se3.log(q)) - np.abs(angle * axis)).max() < 1e-8 * angle + 1e-16
    assert np.abs(se3.log(-q)).max() <= np.abs(angle * axis).max() + 1e-15


def test_from_matrix_at_half_turns():
    """w is zero there: the largest other component must carry the result."""
    for axis in np.eye(3):
        m = Rotation.from_rotvec(np.pi * axis).as_matrix()
        assert np.abs(se3.to_matrix(se3.from_matrix(m)) - m).max() < TOLERANCE


def test_poses_compose_as_matrices():
    """compose, inverse and transform against 4x4 matrices."""
    for a, b in zip(random_poses(20, 7), random_poses(20, 8)):
        assert np.abs(matrix(se3.compose(a, b)) - matrix(a) @ matrix(b)).max() < 2e-14
        assert np.abs(matrix(se3.inverse(a)) - np.linalg.inv(matrix(a))).max() < 2e-14
        assert np.abs(se3.transform(a, b[:3]) - (matrix(a) @ np.append(b[:3], 1))[:3]).max() < 2e-14


def test_twist_of_a_frame_in_a_moving_frame_is_the_derivative_of_its_pose():
    """compose_twist against central differences of composed motions."""
    outer, inner = random_poses(2, 11)
    outer_twist, inner_twist = np.random.default_rng(12).normal(size=(2, 6))

    def moved(pose, twist, t):
        return se3.make_pose(pose[:3] + t * twist[:3], se3.multiply(se3.exp(t * twist[3:]), pose[3:]))

    h = 1e-5
    later, before = (se3.compose(moved(outer, outer_twist, t), moved(inner, inner_twist, t)) for t in (h, -h))
    v = (later[:3] - before[:3]) / (2 * h)
    omega = se3.log(se3.multiply(later[3:], se3.conjugate(before[3:]))) / (2 * h)
    twist = se3.compose_twist(outer, outer_twist, inner, inner_twist)
    assert np.abs(twist - np.concatenate((v, omega))).max() < 1e-9  # h^2 of the difference quotient


def test_mujoco_order():
    """MuJoCo's own rotation of a vector is the reference."""
    import mujoco

    q = random_quaternions(1, 20)[0]
    v, out = np.array([0.3, -2.0, 1.0]), np.zeros(3)
    mujoco.mju_rotVecQuat(out, v, se3.to_mujoco(q))
    assert np.abs(out - se3.rotate(q, v)).max() < TOLERANCE
    assert np.array_equal(se3.from_mujoco(se3.to_mujoco(q)), q)


def test_look_at_is_an_opencv_camera():
    """+z at the target, image right to the right, image down against up."""
    pose = se3.look_at(np.array([1.0, 2.0, 3.0]), np.array([1.0, 5.0, 3.0]))
    assert np.allclose(se3.rotate(pose[3:], np.eye(3)), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)


def test_look_at_refuses_what_has_no_direction():
    """Both errors say what to change."""
    with pytest.raises(ValueError, match="where it stands"):
        se3.look_at(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="along 'up'"):
        se3.look_at(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    with pytest.raises(ValueError, match="no rotation"):
        se3.normalize(np.zeros(4))


def test_the_angle_of_a_rotation_is_that_of_its_vector():
    """Against scipy; q and -q are one rotation, and near 0 and pi nothing is lost."""
    q = np.vstack([random_quaternions(200, 4), se3.exp(np.array([[1e-9, 0, 0], [0, np.pi - 1e-9, 0], [0, 0, 0]]))])
    expected = Rotation.from_quat(q).magnitude()
    assert np.abs(se3.angle(q) - expected).max() < 2e-14
    assert np.array_equal(se3.angle(-q), se3.angle(q))
