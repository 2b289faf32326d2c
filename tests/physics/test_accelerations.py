"""Accelerations against v^2 / r, g, and difference quotients of exact velocities."""

import numpy as np
import pytest

from evis.geometry import se3
from evis.scene.load import load_scene
from evis.scene.motion import Linear, Path, Prescribed, Sinusoid, Spin, Swing, Turn
from evis.scene.spline import Spline

Z = np.array([0.0, 0.0, 1.0])
X = np.array([1.0, 0.0, 0.0])


def test_on_a_circle_it_is_v_squared_over_r():
    """A body 0.5 m from the axis of a carrier at 8 rad/s: 32 m/s^2 towards the axis."""
    hub = Prescribed(se3.IDENTITY, [Spin(Z, 8.0)])
    rim = Prescribed(se3.make_pose(np.array([0.5, 0, 0]), se3.IDENTITY[3:]), [], hub)
    t = np.array([0, 123_456_789, 10**9])
    pose, twist = rim.state(t)
    found = rim.acceleration(t)
    speed = np.linalg.norm(twist[:, :3], axis=1)
    assert np.allclose(found[:, :3], -(speed**2 / 0.5)[:, None] * pose[:, :3] / 0.5, rtol=1e-12)
    assert np.allclose(np.linalg.norm(found[:, :3], axis=1), 32.0) and not found[:, 3:].any()


@pytest.mark.parametrize("loop", [False, True])
def test_it_is_the_derivative_of_the_velocity(loop):
    """Every kind of motion, chained and carried by one that turns and shifts: central difference over 2 us."""
    times = np.array([0.0, 0.3, 0.7, 1.0])
    way = np.array([[0, 0, 0], [1, 0.5, 0], [0, 1, 2], [0, 0, 0]], float)
    carrier = Prescribed(
        se3.make_pose(np.array([1.0, 2, 3]), se3.exp(np.array([0.3, 0.2, 0]))),
        [Spin(Z, 3.0), Swing(X, 0.7, 2.0, 0.4), Sinusoid(np.array([0.1, 0.2, 0.3]), 3.0, 0.2), Linear(X)],
    )
    rider = Prescribed(
        se3.make_pose(np.array([0.4, 0, 0.2]), se3.exp(np.array([0, 0.5, 0]))),
        [Path(Spline(times, way, loop)), Turn(X, Spline(times, way[:, :1], loop)), Swing(Z, 1.0, 1.5), Spin(X, -4.0)],
        carrier,
    )
    t, h = np.array([50, 123, 350, 512, 777, 950]) * 1_000_000, 1000
    expected = (rider.twist(t + h) - rider.twist(t - h)) / (2e-9 * h)
    found = rider.acceleration(t)
    assert np.abs(found).max() > 10 and np.abs(found - expected).max() < 1e-6 * np.abs(found).max()


def test_a_spline_goes_on_straight_beyond_its_ends():
    spline = Spline(np.array([0.0, 1.0, 2.0]), np.array([[0.0], [2.0], [1.0]]))
    assert not spline.bend(np.array([-0.5, 2.5])).any() and spline.bend(np.array([0.5]))[0, 0] != 0


MODEL = """<mujoco><option timestep="0.0005" integrator="RK4" gravity="0 0 -9.81"/><worldbody>
<body name="falls" pos="0 0 5"><freejoint/><geom size="0.1" mass="1" contype="0" conaffinity="0"/></body>
<body name="rests" pos="2 0 0"><geom size="0.1" mass="1" contype="0" conaffinity="0"/></body>
<body name="turns" pos="4 0 0"><joint name="hinge" type="hinge" axis="0 0 1"/>
  <geom size="0.1" mass="1" contype="0" conaffinity="0"/>
  <body name="rim" pos="0.5 0 0"><geom size="0.05" mass="0.1" contype="0" conaffinity="0"/></body></body>
</worldbody><keyframe><key qpos="0 0 5 1 0 0 0 0" qvel="0 0 0 0 0 0 8"/></keyframe></mujoco>"""


@pytest.fixture
def engine(tmp_path):
    from nodes.physics.engines.mujoco_engine import MujocoEngine
    from nodes.physics.interval import Extras

    (tmp_path / "m.xml").write_text(MODEL)
    scene = load_scene(str(tmp_path / "m.xml"))
    scene.keyframe, scene.initial_spread = 0, (0.0, 0.0)
    return MujocoEngine(scene, envs=2, extras=Extras(accelerations=True, joints=True)), [b.name for b in scene.bodies]


def test_forces_give_g_and_v_squared_over_r(engine):
    """A ball in free fall, a body at rest, and a rim at 8 rad/s and 0.5 m, at a stamp between sub-steps."""
    mujoco, names = engine
    assert np.allclose(mujoco.start().acceleration[:, names.index("falls"), :3], [0, 0, -9.81])
    interval = mujoco.advance(33_333_333)
    found = interval.acceleration
    falls, rests, rim = (names.index(n) for n in ("falls", "rests", "rim"))
    assert found.shape == (2, len(names), 6)
    assert np.allclose(found[:, falls], [0, 0, -9.81, 0, 0, 0], atol=1e-9)
    assert np.allclose(found[:, rests], 0, atol=1e-9)
    arm = interval.end_pose[:, rim, :3] - interval.end_pose[:, names.index("turns"), :3]
    rate = interval.qvel[:, -1, -1:]
    assert np.abs(rate - 8).max() < 1e-6
    assert np.allclose(found[:, rim, :3], -(rate**2) * arm, rtol=1e-6, atol=1e-6)


def test_asking_changes_nothing_of_the_course(tmp_path, engine):
    """Bit for bit."""
    from nodes.physics.engines.mujoco_engine import MujocoEngine

    asked, _ = engine
    silent = MujocoEngine(asked.scene, envs=2)
    for stamp in (33_333_333, 66_666_667):
        one, other = asked.advance(stamp), silent.advance(stamp)
        assert one.pose.tobytes() == other.pose.tobytes() and other.acceleration is None
