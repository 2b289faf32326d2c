"""Splines against SciPy's, and bodies that follow them: poses and exact twists."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from evis.geometry import se3
from evis.scene import SceneError, load_scene
from evis.scene.motion import Path, Prescribed, Turn
from evis.scene.spline import Spline

TIMES = np.array([0.0, 0.4, 1.0, 1.3, 2.5])
VALUES = np.array([[0.0, 1, 2], [1, -1, 0], [0.5, 2, 1], [2, 2, -1], [0, 1, 2]])


def test_clamped_spline_is_scipy_s():
    """Values and rates inside; beyond the ends it goes on straight."""
    start, end = np.array([1.0, 0, -2]), np.array([0.0, 3, 1])
    reference = CubicSpline(TIMES, VALUES, bc_type=((1, start), (1, end)))
    spline = Spline(TIMES, VALUES, start_rate=start, end_rate=end)
    t = np.linspace(0, 2.5, 101)
    value, rate = spline(t)
    assert np.abs(value - reference(t)).max() < 1e-12 and np.abs(rate - reference(t, 1)).max() < 1e-11
    value, rate = spline(np.array([-1.0, 4.5]))
    assert np.allclose(value, [VALUES[0] - start, VALUES[-1] + 2 * end]) and np.allclose(rate, [start, end])


def test_loop_is_scipy_s_periodic_spline():
    """For many laps, at negative times too; two points are enough for a straight loop."""
    reference = CubicSpline(TIMES, VALUES, bc_type="periodic")
    spline = Spline(TIMES, VALUES, loop=True)
    t = np.linspace(-7, 9, 203)
    value, rate = spline(t)
    assert np.abs(value - reference(t)).max() < 1e-11 and np.abs(rate - reference(t, 1)).max() < 1e-10
    value, rate = Spline(np.array([0.0, 2.0]), np.array([[0.0], [2 * np.pi]]), loop=True)(np.array([0.5, 7.0]))
    assert np.allclose(value[:, 0], [np.pi / 2, 7 * np.pi]) and np.allclose(rate, np.pi)


def test_an_angle_that_goes_round_has_no_jump():
    """From 0 to a full turn: each lap adds one, and the rate is the same on both sides of the seam."""
    spline = Spline(TIMES, np.array([0.0, 2.0, 3.0, 5.0, 2 * np.pi]), loop=True)
    (before,), (rate_before,) = (v[:, 0] for v in spline(np.array([2.5 - 1e-9])))
    (after,), (rate_after,) = (v[:, 0] for v in spline(np.array([2.5 + 1e-9])))
    assert abs(after - before) < 1e-7 and abs(after - 2 * np.pi) < 1e-7 and abs(rate_after - rate_before) < 1e-6


def test_twists_are_derivatives():
    """A path with yaw, pitch and roll, and a camera on it, against central differences of the poses."""
    angles = np.array([0.0, 1.2, 2.0, 4.0, 2 * np.pi])
    turns = [Turn(axis, Spline(TIMES, k * angles, loop=True)) for k, axis in zip((1, -1, 2), np.eye(3)[::-1])]
    drone = Prescribed(se3.IDENTITY, [Path(Spline(TIMES, VALUES, loop=True)), *turns])
    eye = Prescribed(se3.look_at(np.array([0.1, 0, 0]), np.array([1.0, 0.2, 0])), parent=drone)
    t, h = np.arange(7) * 611_000_000 + 13, 10_000
    later, earlier, twist = eye.pose(t + h), eye.pose(t - h), eye.twist(t)
    v = (later[:, :3] - earlier[:, :3]) / (2e-9 * h)
    omega = se3.log(se3.multiply(later[:, 3:], se3.conjugate(earlier[:, 3:]))) / (2e-9 * h)
    assert np.abs(twist[:, 3:]).max() > 5 and not eye.is_static()
    assert np.abs(twist - np.concatenate((v, omega), axis=-1)).max() < 1e-5  # h^2 times third derivatives of 1e4


SCENE = """
cameras: {cam0: {fov: 1, parent: cart}}
bodies:
  cart:
    position: [0, 0, 1]
    motion:
      - {kind: path, times: [0, 1, 2], points: [[0, 0, 0], [1, 0, 0], [1, 2, 0]], start_velocity: [1, 0, 0]}
      - {kind: turn, axis: [0, 0, 1], times: [0, 2], angles: [0, 90 deg]}
"""


def test_scene_file(tmp_path):
    """Waypoints are met; mistakes are one line with file and line."""
    path = tmp_path / "s.yaml"
    path.write_text(SCENE)
    trajectory = load_scene(str(path)).bodies[0].trajectory
    pose = trajectory.pose(np.array([0, 1, 2]) * 1_000_000_000)
    assert np.allclose(pose[:, :3], [[0, 0, 1], [1, 0, 1], [1, 2, 1]])
    assert np.allclose(se3.log(pose[2, 3:]), [0, 0, np.pi / 2])
    assert np.allclose(trajectory.twist(np.zeros(1, np.int64))[0], [1, 0, 0, 0, 0, 0])
    for old, new, words in (
        ("times: [0, 1, 2]", "times: [0, 2, 1]", "times must increase"),
        ("times: [0, 1, 2]", "times: [0, 1e-200, 2]", "times must increase .* by a nanosecond"),
        ("times: [0, 1, 2]", "times: [0, 1]", "points has 3 entries; `times` has 2"),
        ("times: [0, 1, 2]", "times: 3", "times must be a list of 2 to 1000"),
        ("[1, 2, 0]]", "[1, 2]]", r"points is \[1, 2\]; it must be a list of 3"),
        ("start_velocity: [1, 0, 0]", "loop: true, start_velocity: [1, 0, 0]", "no meaning with `loop`"),
        ("90 deg]", "north]", "angles is 'north'; it must be a finite number"),
    ):
        assert old in SCENE
        path.write_text(SCENE.replace(old, new))
        with pytest.raises(SceneError, match=rf"s\.yaml:[78].*{words}"):
            load_scene(str(path))
