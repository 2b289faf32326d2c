"""Trajectories read from files: against a motion known in closed form, and in the columns of other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evis.geometry import se3
from evis.scene import Scene, SceneError, load_scene
from evis.scene.motion import Prescribed, Sinusoid, Swing

TRUTH = Prescribed(
    se3.make_pose(np.array([3.0, -2.0, 1.0]), se3.exp(np.array([1.2, 0.3, -0.4]))),
    [
        Sinusoid(np.array([1.0, 0.3, -0.2]), 1.0, np.pi / 2),
        Swing(np.array([0.0, 0, 1]), 0.5, 1.0, np.pi / 2),
        Swing(np.array([0.0, 1, 0]), 0.3, 1.0, np.pi / 2),
    ],
)
"""At rest at 0 and at 2 s, as what is read is: sines of 1 Hz at their turning points."""
STEP_NS = 5_000_000


def scene_of(folder: Path, text: str, trajectory: str, more: str = "") -> Scene:
    """Loads a scene whose camera follows a file of this text."""
    (folder / "poses.txt").write_text(text)
    (folder / "s.yaml").write_text(
        f"cameras: {{cam0: {{fov: 1, trajectory: {{{trajectory}}}{more}}}}}\nenvironment: 1\n"
    )
    return load_scene(str(folder / "s.yaml"))


def poses(step_ns: int = STEP_NS) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(0, 2_000_000_001, step_ns)
    return t, TRUTH.pose(t)


def test_poses_between_those_of_the_file(tmp_path):
    """TUM's columns with Unix times, quaternions of either sign, 5 ms apart: position, orientation, velocities and
    accelerations against closed form. Bounds: those of cubic splines, h^4 max|f''''| 5/384 (13 nm for 1 m at 1 Hz), its
    derivatives h^3/24 and h^2/8 (C. Hall, Journal of Approximation Theory 1, 1968)."""
    t, pose = poses()
    signs = np.where(np.arange(len(t)) % 3 == 0, -1.0, 1.0)[:, None]
    rows = np.hstack([pose[:, :3], signs * pose[:, 3:]])
    lines = [
        f"{1305031102 + n // 10**9}.{n % 10**9:09d} " + " ".join(f"{v:.15g}" for v in row)
        for n, row in zip(t.tolist(), rows)
    ]
    scene = scene_of(tmp_path, "# timestamp tx ty tz qx qy qz qw\n" + "\n".join(lines), "file: poses.txt")
    followed = scene.bodies[scene.body_index("cam0")].trajectory
    assert isinstance(followed, Prescribed)
    dense = np.arange(0, 2_000_000_001, 333_333)
    found, truth = followed.pose(dense), TRUTH.pose(dense)
    assert np.abs(found[:, :3] - truth[:, :3]).max() < 1.3e-8
    assert se3.angle(se3.multiply(se3.conjugate(truth[:, 3:]), found[:, 3:])).max() < 1.3e-8
    assert np.abs(followed.twist(dense) - TRUTH.twist(dense)).max() < 1.2e-5
    assert np.abs(followed.acceleration(dense) - TRUTH.acceleration(dense)).max() < 1e-2
    still = followed.pose(np.array([-(10**9), 0, 2 * 10**9, 9 * 10**9]))
    assert np.allclose(still[0], still[1]) and np.allclose(still[2], still[3])


@pytest.mark.parametrize(
    ("head", "unit", "order", "columns", "rest"),
    [
        ("# timestamp, x, y, z, qx, qy, qz, qw", "ns", "xyzw", [0, 1, 2, 3, 4, 5, 6], ""),
        ("t,x,y,z,qw,qx,qy,qz,vx", "us", "wxyz", [0, 1, 2, 6, 3, 4, 5], ",0.25"),
    ],
)
def test_columns_of_other_programs(head, unit, order, columns, rest, tmp_path):
    """ESIM's and EuRoC's order: every pose is met at its time, to 1 ns of times of 1.4e18 ns."""
    t, pose = poses(50_000_000)
    per_unit = {"ns": 1, "us": 1000}[unit]
    lines = [
        f"{(1403636579763555584 // per_unit) + n // per_unit}," + ",".join(f"{row[c]:.17g}" for c in columns) + rest
        for n, row in zip(t.tolist(), pose)
    ]
    text = "\n".join([head, *lines])
    scene = scene_of(tmp_path, text, f"file: poses.txt, unit: {unit}, quaternion: {order}")
    followed = scene.bodies[scene.body_index("cam0")].trajectory
    assert followed is not None
    found = followed.pose(t)
    assert np.abs(found[:, :3] - pose[:, :3]).max() < 1e-12
    assert se3.angle(se3.multiply(se3.conjugate(pose[:, 3:]), found[:, 3:])).max() < 1e-12


GOOD = "0 0 0 0 0 0 0 1\n1 0 0 1 0 0 0 1\n"


def test_motion_adds_to_it_and_a_change_of_the_file_is_seen(tmp_path):
    more = ", motion: {kind: linear, velocity: [1, 0, 0]}"
    for height in (1, 2):
        scene = scene_of(tmp_path, GOOD.replace("0 0 1 0", f"0 0 {height} 0"), "file: poses.txt", more)
        trajectory = scene.bodies[scene.body_index("cam0")].trajectory
        assert trajectory is not None
        assert np.allclose(trajectory.pose(np.array([10**9]))[0], [1, 0, height, 0, 0, 0, 1])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no two poses"),
        (GOOD[:16], "no two poses"),
        (GOOD + "2 0 0 0 1\n", "line 3 has 5 numbers"),
        (GOOD + "2 0 0 zero 0 0 0 1\n", "line 3 is no time and pose"),
        (GOOD + "1 0 0 0 0 0 0 1\n", "line 3: time 1 does not come after"),
        (GOOD + "2 0 nan 0 0 0 0 1\n", "line 3 has a number that is not finite"),
        (GOOD + "2 0 0 0 0 0 0 0\n", "the quaternion of pose 3 has norm 0"),
        (GOOD + "2 0 0 0 0 0 0 2\n", "the quaternion of pose 3 has norm 2"),
        (GOOD + "1403636579763555584 0 0 0 0 0 0 1\n", "is their unit right?"),
        (GOOD + "1.0000000001 0 0 0 0 0 0 1\n", "1e-10 s from one to the next at least; is their unit right?"),
    ],
)
def test_what_is_wrong_with_a_file(text, said, tmp_path):
    with pytest.raises(
        SceneError, match=r"s\.yaml:1: camera 'cam0', trajectory: file cannot be used: poses\.txt: "
    ) as e:
        scene_of(tmp_path, text, "file: poses.txt")
    assert said in str(e.value)


@pytest.mark.parametrize(
    ("trajectory", "more", "said"),
    [
        ("file: other.txt", "", "other.txt: No such file"),
        ("file: poses.txt, unit: h", "", "unit is 'h'"),
        ("file: poses.txt, quaternion: xyz", "", "quaternion is 'xyz'"),
        ("file: poses.txt", ", position: [0, 0, 1]", "position and a trajectory are given"),
        ("file: poses.txt, loop: true", "", "loop is not known here"),
    ],
)
def test_what_is_wrong_with_the_entry(trajectory, more, said, tmp_path):
    with pytest.raises(SceneError) as error:
        scene_of(tmp_path, GOOD, trajectory, more)
    assert said in str(error.value)


def test_as_many_poses_as_there_may_be(tmp_path):
    """A spline of 100,000 is solved in less memory than a matrix of them has; one more is refused."""
    lines = [f"{n} {n % 7} 0 0 0 0 0 1" for n in range(100_001)]
    scene = scene_of(tmp_path, "\n".join(lines[:-1]), "file: poses.txt, unit: ms")
    trajectory = scene.bodies[scene.body_index("cam0")].trajectory
    assert trajectory is not None
    assert np.allclose(trajectory.pose(np.array([99_999_000_000]))[0, 0], 99_999 % 7)
    with pytest.raises(SceneError, match="more than 100,000 poses"):
        scene_of(tmp_path, "\n".join(lines), "file: poses.txt, unit: ms")
