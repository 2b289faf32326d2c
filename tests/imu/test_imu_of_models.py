"""The inertial unit on bodies that MuJoCo moves, at keyframes that lie between its steps: free fall, rest, another
keyframe rate."""

import numpy as np
import pytest

from evis.runtime.clock import keyframe_stamp
from evis.scene import load_scene
from msgs.header import Header
from msgs.world import WorldState
from nodes.imu.node import ImuNode
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.interval import Extras

MODEL = """
<mujoco>
  <option gravity="{gravity}" integrator="{integrator}"/>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body name="p" pos="0 0 {height}">{joint}<geom size=".1" contype="0" conaffinity="0"/>
      <camera name="cam0" xyaxes="1 0 0 0 0 1"/></body>
  </worldbody>
</mujoco>
"""


class Wire:
    """Stands for the executor."""

    def __init__(self):
        self.messages = []

    def publish(self, node, port, message):
        self.messages.append(message)

    def count(self, node, name, amount):
        pass


def read(scene, rate, keyframes, camera="cam0"):
    """Readings of a run, and its states. (Messages [keyframes], each stamp's velocity of the camera and qvel.)"""
    engine = MujocoEngine(scene, extras=Extras(joints=True))
    node = ImuNode("imu", {"camera": camera})
    node.runtime = Wire()
    node.setup()
    states = []
    for k in range(keyframes + 1):
        stamp = keyframe_stamp(k, rate)
        i = engine.advance(stamp) if k else engine.start()
        names = [body.name for body in scene.bodies]
        given = {name: getattr(i, name) for name in ("t", "end_pose", "moving", "moving_pose", "moving_twist")}
        given |= {"qpos": i.qpos, "qvel": i.qvel, "gravity": i.gravity, "episodes": np.zeros(1, np.int32)}
        state = WorldState(Header(stamp), names=names, **given)
        state.check()
        node.update({"state": state})
        states.append(state)
    return node.runtime.messages[1:], states


def scene_of(tmp_path, gravity, integrator="Euler", joint="<freejoint/>", height=100.0):
    path = tmp_path / "model.xml"
    path.write_text(MODEL.format(gravity=gravity, integrator=integrator, joint=joint, height=height))
    return load_scene(str(path))


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("gravity", ["0 0 -9.81", "0 0 -1.62", "0 -3.7 0", "0 0 0"])
def test_a_falling_camera_feels_nothing(tmp_path, gravity, integrator):
    """Keyframes at 30 and 24 Hz lie a third and two thirds of the way between steps of 1 ms."""
    for rate in (30, 24):
        for message in read(scene_of(tmp_path, gravity, integrator), rate, 4)[0]:
            # Velocities of 1 m/s are known to 1e-16, and are 1/3 ms apart.
            np.testing.assert_allclose(message.acceleration, 0.0, atol=1e-10)


@pytest.mark.parametrize("rate", [30, 24, 17.3])
def test_velocities_at_keyframes_are_those_of_free_fall_and_of_the_joints(tmp_path, rate):
    _, states = read(scene_of(tmp_path, "0 0 -9.81"), rate, 5)
    for state in states[1:]:
        body = state.names.index("p")
        fallen = [0, 0, -9.81e-9 * state.header.stamp_ns]
        np.testing.assert_allclose(state.end_twist()[0, body, :3], fallen, rtol=1e-12)
        np.testing.assert_allclose(state.qvel[0, -1, :3], fallen, rtol=1e-12)


def test_a_camera_at_rest_feels_the_gravity_of_the_model(tmp_path):
    """The camera looks along the world's y, so that up is its -y."""
    for message in read(scene_of(tmp_path, "0 0 -1.62", joint=""), 30, 2)[0]:
        np.testing.assert_allclose(message.acceleration, np.tile([0, -1.62, 0], (len(message.t), 1)), atol=1e-12)


def test_readings_of_an_arm_do_not_depend_on_the_keyframe_rate():
    """At 25 Hz keyframes lie on steps, at 30 Hz two of three do not. What a straight line between two steps leaves out
    is an eighth of the second difference of velocities, here some parts in a thousand of the readings."""
    scene = load_scene("robot_arm")
    slow, fast = (
        {
            t: f
            for message in read(scene, rate, n, "hand_eye")[0]
            for t, f in zip(message.t.tolist(), message.acceleration)
        }
        for rate, n in ((25, 6), (30, 7))
    )
    common = [t for t in slow if t in fast and t < 230_000_000]
    assert len(common) > 200
    a, b = (np.array([of[t] for t in common]) for of in (slow, fast))
    assert np.abs(a - b).max() < 0.02 * np.linalg.norm(a, axis=1).max()
