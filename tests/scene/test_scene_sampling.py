"""What frames are too slow for, against what sampling theory says and what samples of the thing itself show."""

import numpy as np
import pytest

from evis.geometry import se3
from evis.scene import load_scene
from evis.scene.model import Body, Light, Scene, Waveform
from evis.scene.motion import Prescribed, Sinusoid, Spin, Swing
from evis.scene.sampling import undersampled

REST = se3.make_pose(np.zeros(3), np.array([0, 0, 0, 1.0]))
Z = np.array([0, 0, 1.0])


def scene(*motions, flicker=None):
    light = Light("sun", "directional", np.ones(3), Z, waveform=flicker)
    return Scene("case", [Body("rotor", Prescribed(REST, motions))], [], [], [light], [], np.zeros(3))


def seen_frequency(phases):
    """Of e^(i phase) in equal steps: |turns| per step, as it looks, in -1/2 ... 1/2."""
    step = np.angle(np.exp(1j * np.diff(phases)))
    return np.abs(step).mean() / (2 * np.pi)


@pytest.mark.parametrize("rate", [1.0, 59.0, 119.0, 121.0, 239.0, 240.0, 10_000.0])
def test_a_turn_is_named_when_frames_show_another_rate(rate):
    """At 240 frames per second: just where the angle that frames by themselves show is not the angle turned."""
    phases = 2 * np.pi * rate * np.arange(100) / 240
    false = not np.isclose(seen_frequency(phases) * 240, rate)
    lines = undersampled(scene(Spin(Z, 2 * np.pi * rate)), 240)
    assert len(lines) == false
    assert all(f"body 'rotor' makes {rate:.4g} turns" in line and "frames come at 240 Hz" in line for line in lines)


@pytest.mark.parametrize(
    "frequency, depth, lines", [(100, 0.5, 0), (119.9, 1, 0), (120, 1, 1), (240, 0.5, 1), (240, 0, 0)]
)
def test_flicker_up_to_half_of_the_frame_rate(frequency, depth, lines):
    """At 240 Hz every frame falls on the same phase, at 120 Hz on two: both may look still."""
    found = undersampled(scene(flicker=Waveform("sine", frequency, depth)), 240)
    assert len(found) == lines
    assert all(f"light 'sun' flickers at {frequency:g} Hz" in line for line in found)


def test_what_swings_counts_by_its_frequency_and_by_its_rate():
    assert undersampled(scene(Sinusoid(Z, 119.0)), 240) == []
    assert len(undersampled(scene(Sinusoid(Z, 121.0)), 240)) == 1
    assert undersampled(scene(Sinusoid(0 * Z, 121.0)), 240) == []
    assert len(undersampled(scene(Swing(Z, 1e-3, 121.0)), 240)) == 1
    # 100 rad to and fro ten times a second is up to 1000 turns per second.
    assert len(undersampled(scene(Swing(Z, 100.0, 10.0)), 240)) == 1
    assert undersampled(scene(Swing(Z, 1.0, 10.0)), 240) == []


@pytest.mark.parametrize("name", ["spinning_disk", "fidget_spinner", "drone", "tunnel_exit", "falling_objects"])
def test_the_shipped_scenes_are_slow_enough_for_the_default_frames(name):
    assert undersampled(load_scene(name, textures=False), 240) == []
