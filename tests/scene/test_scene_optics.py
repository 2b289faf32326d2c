"""Lights and cameras of scene files."""

import numpy as np
import pytest

from evis.scene import SceneError, load_scene

TEXT = """
cameras:
  cam0: {fov: 60 deg, supersampling: 3, distortion: {model: plumb_bob, coefficients: [-0.2, 0.05, 0.001, 0.002, 0]}}
  fish: {fov: 180 deg, width: 200, height: 100, distortion: {model: equidistant, coefficients: [0.01, 0, 0, 0]}}
bodies: {cart: {motion: {kind: linear, velocity: [1, 0, 0]}}}
lights:
  spot:
    {kind: spot, position: [0, 0, 3], look_at: [0, 4, 0], cone: 30 deg, full: 20 deg, intensity: [1, 2, 3], body: cart}
  soft: {kind: spot, position: [0, 0, 3], direction: [0, 0, -1], cone: 0.5, intensity: 1}
  panel: {kind: area, position: [1, 2, 3], direction: [0, 0, -2], size: [2, 0.5], radiance: 7, shadows: false}
  tilted: {kind: area, position: [1, 2, 3], look_at: [4, 6, 3], up: [0, 0, 1], size: [2, 0.5], radiance: 7}
  mains:
    {kind: point, position: [0, 0, 1], intensity: 1, flicker: {kind: sine, frequency: 100, depth: 0.3, phase: 0.25}}
  pwm: {kind: directional, direction: [0, 0, -1], irradiance: 1, flicker: {kind: square, frequency: 240, duty: 0.2}}
"""


@pytest.fixture
def load(tmp_path):
    def load(text=TEXT):
        (tmp_path / "s.yaml").write_text(text)
        return load_scene(str(tmp_path / "s.yaml"))

    return load


def test_lights(load):
    """Directions, cones and half-edges; an area light shines to the side of half_u x half_v."""
    scene = load()
    light = {x.name: x for x in scene.lights}
    assert light["spot"].body == 0 and light["spot"].colour.tolist() == [1, 2, 3]
    assert np.allclose(light["spot"].direction, [0, 0.8, -0.6])
    assert np.allclose(light["spot"].cone, np.radians([20, 30])) and np.allclose(light["soft"].cone, [0.4, 0.5])
    for name, direction in (("panel", [0, 0, -1]), ("tilted", [0.6, 0.8, 0])):
        u, v = light[name].half_u, light[name].half_v
        assert np.isclose(np.linalg.norm(u), 1) and np.isclose(np.linalg.norm(v), 0.25) and abs(u @ v) < 1e-12
        assert np.allclose(np.cross(u, v), 0.25 * np.array(direction)) and light[name].vector.tolist() == [1, 2, 3]
    assert abs(light["tilted"].half_u[2]) < 1e-12, "the width lies across `up`"
    assert not light["panel"].shadows and light["tilted"].shadows and light["panel"].colour.tolist() == [7] * 3


def test_flicker(load):
    """As the file has it; without one there is none."""
    light = {x.name: x.waveform for x in load().lights}
    mains, pwm = light["mains"], light["pwm"]
    assert (mains.kind, mains.frequency, mains.depth, mains.phase) == ("sine", 100, 0.3, 0.25)
    assert (pwm.kind, pwm.frequency, pwm.depth, pwm.phase, pwm.duty) == ("square", 240, 1.0, 0.0, 0.2)
    assert light["spot"] is None


def test_cameras(load):
    """Distortion and samples; the focal length of a fisheye is height / angle."""
    first, fish = load().cameras
    assert first.distortion_model == "plumb_bob" and first.distortion == (-0.2, 0.05, 0.001, 0.002, 0.0)
    assert first.supersampling == 3 and fish.supersampling == 1
    assert fish.distortion_model == "equidistant" and np.isclose(fish.k[0, 0], 100 / np.pi)
    plain = load("cameras: {cam0: {fov: 1}}\n").cameras[0]
    assert (plain.distortion_model, plain.distortion, plain.supersampling) == ("none", (), 1)


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("cone: 30 deg", "cone: 100 deg", "the half-angle must lie between 0 and 90 deg"),
        ("full: 20 deg", "full: 40 deg", "it must lie between 0 and the cone"),
        ("look_at: [0, 4, 0]", "up: [0, 0, 1]", "needs 'direction' or 'look_at'"),
        ("look_at: [0, 4, 0]", "look_at: [0, 4, 0], direction: [0, 0, 1]", "and direction are given; leave one out"),
        ("look_at: [0, 4, 0]", "look_at: [0, 0, 3]", "look_at cannot be followed: the light looks at the point where"),
        ("size: [2, 0.5], radiance: 7, shadows", "size: [2, 0], radiance: 7, shadows", "must be more than 0"),
        ("size: [2, 0.5], radiance: 7, shadows", "size: [2, 1], intensity: 7, shadows", "needs 'radiance'"),
        ("kind: sine", "kind: sin", "kind is 'sin'; did you mean 'sine'"),
        ("frequency: 100", "frequency: 0", "frequency is 0; it must be more than 0"),
        ("depth: 0.3", "depth: 1.3", "depth is 1.3; the most is 1"),
        ("depth: 0.3", "duty: 0.3", "duty is for kind square"),
        ("duty: 0.2", "duty: 1", "duty is 1; it must lie between 0 and 1"),
        ("model: plumb_bob", "model: plumb", "model is 'plumb'; did you mean 'plumb_bob'"),
        ("[-0.2, 0.05, 0.001, 0.002, 0]", "[-0.2, 0.05]", "plumb_bob has 4 or 5 or 8 of them"),
        ("[0.01, 0, 0, 0]", "[0.01, 0, 0, .nan]", "coefficients is nan; it must be a finite number"),
        ("supersampling: 3", "supersampling: 0", "must be a whole number from 1 to 16"),
    ],
)
def test_mistakes(load, old, new, words):
    """One line with file and line."""
    assert old in TEXT
    with pytest.raises(SceneError) as caught:
        load(TEXT.replace(old, new))
    assert words in str(caught.value) and "s.yaml:" in str(caught.value) and "\n" not in str(caught.value)
