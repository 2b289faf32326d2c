"""The node: one message per state, in the camera's axes, on the graph's own physics; clear errors."""

import numpy as np
import pytest

from evis.config.params import ParamError
from evis.geometry import se3
from evis.scene import load_scene
from msgs.header import Header
from msgs.world import WorldState
from nodes.imu.node import ImuNode
from nodes.physics.engines.prescribed import PrescribedEngine

MS = 1_000_000


class Wire:
    """Stands for the executor."""

    def __init__(self):
        self.messages, self.counted = [], {}

    def publish(self, node, port, message):
        message.check()
        self.messages.append(message)

    def count(self, node, name, amount):
        self.counted[name] = self.counted.get(name, 0) + amount


def start(name="imu", **params):
    node = ImuNode(name, params)
    node.runtime = Wire()
    node.setup()
    return node


def state(t, envs=1, episode=0, names=("ball", "cam0"), speed=0.0):
    """Bodies that hang at the identity, with a speed along x that is only said."""
    t = np.atleast_1d(np.asarray(t, np.int64))
    pose = np.tile(se3.IDENTITY, (envs, len(t), len(names), 1))
    twist = np.zeros((envs, len(t), len(names), 6))
    twist[..., 0] = speed
    header = Header(int(t[-1]), clock="sim", episode=episode)
    return WorldState.dense(header, t, pose, twist, np.full(envs, episode, np.int32), names=list(names))


def test_one_message_per_state_the_first_is_empty():
    node = start(rate=500)
    for t in ([0], [0, 5 * MS, 10 * MS], [10 * MS, 13 * MS]):
        node.update({"state": state(t, episode=2)})
    messages = node.runtime.messages
    assert [m.header.stamp_ns for m in messages] == [0, 10 * MS, 13 * MS]
    assert all((m.header.episode, m.header.clock) == (2, "sim") for m in messages)
    assert [m.t.tolist() for m in messages] == [[], [2 * MS, 4 * MS, 6 * MS, 8 * MS, 10 * MS], [12 * MS]]
    np.testing.assert_allclose(messages[1].acceleration, np.tile([0, 0, 9.81], (5, 1)), atol=1e-12)


def test_the_camera_of_a_scene_feels_gravity_along_its_own_axes():
    """The disk's camera does not move: whatever its pose, f turned back into the world is 9.81 upwards."""
    scene = load_scene("spinning_disk")
    engine = PrescribedEngine(scene)
    node = start()
    names = [body.name for body in scene.bodies]
    for to in (0, 33_333_333, 66_666_667):
        interval = engine.start() if to == 0 else engine.advance(to)
        message = WorldState.dense(
            Header(to), interval.t, interval.pose, interval.twist, np.zeros(1, np.int32), names=names
        )  # fmt: skip
        node.update({"state": message})
    sent = node.runtime.messages
    assert [len(m.t) for m in sent] == [0, 33, 33]
    q = interval.pose[0, -1, names.index("cam0"), 3:]
    for m in sent[1:]:
        np.testing.assert_allclose(se3.rotate(q, m.acceleration), np.tile([0, 0, 9.81], (33, 1)), atol=1e-9)
        assert np.abs(m.angular_velocity).max() < 1e-12


def test_units_of_a_rig_have_noise_of_their_own():
    """Three units at rest in the same run: noise of 1000 samples, three axes each, correlates by 0.02 at random."""
    nodes = [start(camera=name, accel_noise=0.1, gyro_noise=0.1) for name in ("cam0", "left", "right")]
    for node in nodes:
        for t in ([0], [0, 500 * MS, 1000 * MS]):
            node.update({"state": state(t, names=("cam0", "left", "right"))})
    read = [node.runtime.messages[1] for node in nodes]
    for about in ("acceleration", "angular_velocity"):
        noise = [(getattr(r, about) - getattr(r, about).mean(axis=0)).ravel() for r in read]
        assert np.abs(np.corrcoef(noise) - np.eye(3)).max() < 0.1


def test_units_of_two_namespaces_have_noise_of_their_own_and_shares_of_one_the_same():
    nodes = [start(name, accel_noise=0.1) for name in ("imu", "one/imu", "two/imu", "share0/two/imu", "share1/imu")]
    for node in nodes:
        for t in ([0], [0, 500 * MS, 1000 * MS]):
            node.update({"state": state(t)})
    noise = [read - read.mean(axis=0) for read in (node.runtime.messages[1].acceleration for node in nodes)]
    assert np.abs(np.corrcoef([n.ravel() for n in noise[:3]]) - np.eye(3)).max() < 0.1
    assert np.array_equal(noise[3], noise[2]) and np.array_equal(noise[4], noise[0])


def test_what_was_clipped_is_counted_once():
    node = start(accel_range=5.0)
    for t in ([0], [0, 5 * MS], [5 * MS, 10 * MS]):
        node.update({"state": state(t)})
    assert node.runtime.counted == {"clipped_samples": 10}


def test_received_arrays_are_not_written():
    node = start(accel_noise=0.1)
    message = state([0, 10 * MS])
    for array in message.arrays().values():
        array.flags.writeable = False
    node.update({"state": message})
    assert len(node.runtime.messages[0].t) == 10


def test_a_new_episode_does_not_differentiate_across_the_reset():
    node = start(gravity=0)
    moving = state([0, 5 * MS, 10 * MS], speed=100.0)
    node.update({"state": moving})
    node.update({"state": state([0], episode=1)})
    node.update({"state": state([0, 10 * MS], episode=1)})
    assert not node.runtime.messages[-1].acceleration.any() and len(node.runtime.messages[-1].t) == 10


def test_mistakes_are_named():
    with pytest.raises(ValueError, match="/state has 3 environments; run with envs 1"):
        start().update({"state": state([0], envs=3)})
    with pytest.raises(ValueError, match="no body 'cam1'; did you mean 'cam0'"):
        start(camera="cam1").update({"state": state([0])})
    with pytest.raises(ParamError, match="the least is"):
        start(rate=0)
