"""Poses between two steps, by a kernel, against the same in numpy."""

import numpy as np
import pytest

from evis.geometry import interpolate, se3
from nodes.physics.dynamics.course.poses_between import PosesBetween


@pytest.mark.parametrize("spin", [0.0, 3.0, 6000.0])
@pytest.mark.parametrize("t", [1_000_000, 1_333_333, 1_500_000, 2_000_000])
def test_as_in_numpy(spin: float, t: int) -> None:
    """Of bodies that rest, turn slowly, and turn by almost a turn in a step: to 1e-13 m and rad."""
    random = np.random.Generator(np.random.Philox(5))
    before = np.concatenate((random.normal(size=(4, 3, 3)), se3.normalize(random.normal(size=(4, 3, 4)))), axis=-1)
    twist = random.normal(size=(4, 3, 6)) * (spin > 0)
    axis = twist[..., 3:] / np.maximum(np.linalg.norm(twist[..., 3:], axis=-1, keepdims=True), 1e-300)
    twist[..., 3:] = spin * axis
    now = before.copy()
    now[..., :3] += 1e-3 * twist[..., :3]
    now[..., 3:] = se3.multiply(se3.exp(1e-3 * twist[..., 3:]), before[..., 3:])
    times = np.array([1_000_000, 2_000_000])
    poses, twists = np.stack((before, now), axis=1), np.stack((twist, twist), axis=1)
    expected = interpolate.pose_at(t, times, poses, twists)
    found = np.full((4, 3, 7), np.nan)
    between = PosesBetween(poses, twists, found)
    between.aim(t, times)
    between.write()
    in_parts = np.full((4, 3, 7), np.nan)
    between = PosesBetween(poses, twists, in_parts)
    between.aim(t, times)
    between.write(slice(3, 6))
    between.write(slice(0, 3))
    assert in_parts.tobytes() == found.tobytes()
    np.testing.assert_allclose(found[..., :3], expected[..., :3], rtol=0, atol=1e-13)
    turned = se3.log(se3.multiply(found[..., 3:], se3.conjugate(expected[..., 3:])))
    np.testing.assert_allclose(turned, 0.0, atol=1e-13)
