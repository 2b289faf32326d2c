"""The world that choices are measured in: motion in closed form, also between the steps of a message."""

import numpy as np

from evis.geometry import se3
from evis.scene.model import Body, Scene
from evis.scene.motion import Prescribed, Sinusoid
from nodes.interpolator.auto.world import World

AMPLITUDE, FREQUENCY, DURATION = 0.02, 500.0, 10_000_000


def shaken():
    """Makes a body that shakes at 500 Hz, whose turns all lie between two steps of 1 ms."""
    path = Prescribed(se3.IDENTITY, [Sinusoid(np.array([AMPLITUDE, 0.0, 0.0]), FREQUENCY)])
    return World(Scene("shaken", [Body("body", path)], [], [], [], [], np.zeros(3)), DURATION)


def test_poses_between_the_steps_of_a_message_are_in_closed_form():
    world, t = shaken(), np.arange(0, DURATION + 1, 62_500)
    place = np.array([world.poses(int(stamp))[0, 0, 0] for stamp in t])
    np.testing.assert_allclose(place, AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * t * 1e-9), atol=1e-12)


def test_states_of_a_gap_are_at_its_ends_and_the_steps_between():
    t, pose, twist = shaken().states(250_000, 3_250_000)
    assert t.tolist() == [250_000, 1_000_000, 2_000_000, 3_000_000, 3_250_000]
    phase = 2 * np.pi * FREQUENCY * t * 1e-9
    np.testing.assert_allclose(pose[0, :, 0, 0], AMPLITUDE * np.sin(phase), atol=1e-12)
    speed = 2 * np.pi * FREQUENCY * AMPLITUDE * np.cos(phase)
    np.testing.assert_allclose(twist[0, :, 0, :3], np.stack([speed, 0 * speed, 0 * speed], -1), atol=1e-9)
