"""Prescribed motion against angles worked out by hand, and twists against difference quotients."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evis.geometry import se3
from evis.scene.motion import Linear, Prescribed, Sinusoid, Spin, Swing

Z = np.array([0.0, 0.0, 1.0])
X = np.array([1.0, 0.0, 0.0])
TURNED = se3.make_pose(np.array([1.0, 2.0, 3.0]), Rotation.from_euler("xyz", [0.3, -0.4, 2.0]).as_quat())


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_spin_keeps_its_angle_for_ten_seconds(rate):
    """theta = omega t to the rounding of omega t itself (case P2 of the physics protocol)."""
    t = np.array([0, 1, 123_456_789, 10_000_000_000])
    pose = Prescribed(TURNED, [Spin(Z, rate)]).pose(t)
    expected = (Rotation.from_quat(TURNED[3:]) * Rotation.from_rotvec(np.outer(rate * t * 1e-9, Z))).as_quat()
    assert np.minimum(np.abs(pose[:, 3:] - expected).max(-1), np.abs(pose[:, 3:] + expected).max(-1)).max() < 2e-12
    assert np.array_equal(pose[:, :3], np.tile(TURNED[:3], (4, 1)))
    assert np.abs(np.linalg.norm(pose[:, 3:], axis=-1) - 1).max() < 1e-15


def test_translations_are_along_the_parent_s_axes():
    """They add up, whatever way the body itself faces."""
    motion = Prescribed(TURNED, [Linear(np.array([1.0, 0, 0])), Sinusoid(np.array([0, 0.5, 0]), 2.0)])
    t = np.array([0, 125_000_000])  # a quarter of the period
    assert np.allclose(motion.pose(t)[:, :3], [[1, 2, 3], [1.125, 2.5, 3]])
    assert np.allclose(motion.twist(t)[:, :3], [[1, 2 * np.pi, 0], [1, 0, 0]], atol=1e-12)


def test_rotations_chain_in_the_body_s_frame():
    """spin about z, then about the x that the first left."""
    t = np.array([1_000_000_000])
    pose = Prescribed(se3.IDENTITY, [Spin(Z, np.pi / 2), Spin(X, np.pi / 2)]).pose(t)[0]
    assert np.allclose(se3.rotate(pose[3:], np.eye(3)), [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)


def test_twists_are_derivatives_with_parents_that_move():
    """All kinds of motion at once, three levels deep, against central differences."""
    base = Prescribed(TURNED, [Linear(np.array([0.5, -1, 0.2])), Spin(Z, 3.0)])
    arm = Prescribed(TURNED, [Swing(X, 0.7, 1.5, 0.2), Sinusoid(np.array([0.1, 0.2, 0.3]), 2.5, 1.0)], base)
    tip = Prescribed(TURNED, [Spin(X, -4.0), Swing(Z, 0.4, 3.0)], arm)
    t = np.arange(5) * 217_000_000
    h = 10_000
    twist = tip.twist(t)
    later, before = tip.pose(t + h), tip.pose(t - h)
    v = (later[:, :3] - before[:, :3]) / (2e-9 * h)
    omega = se3.log(se3.multiply(later[:, 3:], se3.conjugate(before[:, 3:]))) / (2e-9 * h)
    assert np.abs(twist).max() > 5
    assert np.abs(twist - np.concatenate((v, omega), axis=-1)).max() < 1e-6  # h^2 times third derivatives of 1e4


def test_static_means_nothing_above_moves_either():
    """A body on a moving parent is not static."""
    still = Prescribed(TURNED)
    assert still.is_static() and Prescribed(TURNED, parent=still).is_static()
    assert not Prescribed(TURNED, parent=Prescribed(TURNED, [Spin(Z, 1.0)])).is_static()
