"""A world in which nothing moves has no sub-steps, and what reads its states misses none."""

import numpy as np

from evis.geometry import se3
from evis.scene.model import Body, Camera, Scene
from evis.scene.motion import Prescribed, Spin
from nodes.imu.inertial import ImuModel, InertialUnit
from nodes.physics.engines.prescribed import PrescribedEngine

HOUR = 3600 * 10**9


def world(*motions):
    k = np.array([[50.0, 0, 16], [0, 50, 12], [0, 0, 1]])
    rest = se3.make_pose(np.array([0, 0, 1.0]), se3.exp(np.array([0.3, -0.2, 0.1])))
    return Scene(
        "still", [Body("cam0", Prescribed(rest, motions))], [], [], [], [Camera("cam0", 32, 24, k)], np.ones(3)
    )


def test_an_hour_of_rest_is_its_two_ends():
    engine = PrescribedEngine(world(), envs=2)
    interval = engine.advance(HOUR)
    assert interval.t.tolist() == [0, HOUR] and interval.pose.shape == (2, 2, 1, 7)
    assert not interval.twist.any() and np.array_equal(interval.pose[:, 0], interval.pose[:, 1])
    assert engine.advance(HOUR + 1).t.tolist() == [HOUR, HOUR + 1]


def test_what_moves_keeps_its_thousand_steps_a_second():
    engine = PrescribedEngine(world(Spin(np.array([0, 0, 1.0]), 1.0)))
    assert len(engine.advance(10**9).t) == 1001


def test_an_inertial_unit_at_rest_reads_gravity_at_its_own_rate():
    """A thousand samples a second of two states: q^-1 g, and no rotation."""
    interval = PrescribedEngine(world()).advance(10**9)
    pose, twist = interval.pose[0, :, 0], interval.twist[0, :, 0]
    read = InertialUnit(ImuModel(rate=1000.0)).advance(interval.t, pose, twist)
    up = se3.rotate(se3.conjugate(pose[0, 3:]), np.array([0, 0, ImuModel().gravity]))
    assert read.t.tolist() == [k * 10**6 for k in range(1, 1001)]
    np.testing.assert_allclose(read.acceleration, np.tile(up, (1000, 1)), rtol=0, atol=1e-12)
    assert not read.angular_velocity.any()
