"""Light of lamps that go by a wall between two frames, or by which wall and camera go, against the closed form."""

from dataclasses import replace

import numpy as np
import pytest
from refine_rig import parts_of, refined
from rigid_rig import GAP, START, closed_form, lamp, plain, pose, quad, world

from evis.scene.motion import Linear, Prescribed
from nodes.renderer.renderer import Renderer

K, WALL, ALBEDO, SKY = 4, 1.5, 0.5, 0.05
TOLERANCE, LN = 20_000, 0.05
CONE = 0.015, 0.02
POINT = replace(lamp(), colour=np.full(3, 4e-4), vector=np.zeros(3))
SPOT = replace(POINT, kind="spot", colour=np.full(3, 2.0), direction=np.array([0, 0, 1.0]), cone=CONE)
CASES = {"point 2 cm before a wall": (POINT, 0.02, 60.0), "beam 4 cm wide": (SPOT, 1.0, 60.0)}
"""Lamp, its distance from the wall [m] and its speed [m/s]: its light is on a point for a part of the 1.25 ms between a
frame and the middle between two of them."""


def passing(light, near, speed, rides, shadows=False):
    """A wall and a lamp that goes by it, in the middle of the image in the middle of the gap; rides: wall and camera go
    by the lamp."""
    ahead = -speed * (START + GAP / 2) * 1e-9
    along = [Linear(np.array([speed, 0, 0]))], [Linear(np.array([-speed, 0, 0]))]
    stand = Prescribed(pose(0 if rides else ahead, 0.2, WALL - near), [] if rides else along[0])
    wall, camera = (Prescribed(pose(-ahead if rides else 0, 0, z), along[1] if rides else []) for z in (WALL, 0))
    scene = world([(quad(6.0), plain(ALBEDO), wall)], camera_motion=camera, spares=[("stand", stand)], sky=SKY)
    scene.lights.append(replace(light, body=[b.name for b in scene.bodies].index("stand"), shadows=shadows))
    return scene


def radiance(light, near, x):
    """What pixels show, float64 [h, w, n], while the lamp is at x [n] m in the camera's frame: I cos / r^2, within a
    spot's cone by a smooth step in the cosine of the angle from its axis."""
    view = world([]).cameras[0]
    u, v = np.meshgrid(np.arange(view.width), np.arange(view.height))
    across, down = WALL * (u - view.k[0, 2]) / view.k[0, 0], WALL * (v - view.k[1, 2]) / view.k[1, 1]
    r = np.sqrt((across[..., None] - x) ** 2 + (down[..., None] - 0.2) ** 2 + near**2)
    strength = np.full(r.shape, light.colour[0])
    if light.kind == "spot":
        full, none = np.cos(CONE)
        step = np.clip((near / r - none) / (full - none), 0, 1)
        strength *= step * step * (3 - 2 * step)
    return ALBEDO * (SKY + strength * near / r**3 / np.pi)


def told(frames, samples, start, pixel, since):
    """ln I of a pixel at times since START, on lines between its frames and its samples."""
    at, offset, value = samples
    own = at == pixel
    times = np.concatenate([np.arange(K + 1) * GAP / K, offset[own]])
    values = np.concatenate([[start.flat[pixel]], frames.reshape(K, -1)[:, pixel], value[own]])
    order = np.argsort(times, kind="stable")
    return np.interp(since, times[order], np.log(values[order].astype(np.float64)))


@pytest.mark.parametrize("rides", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_light_of_a_lamp_that_goes_by_between_two_frames_is_followed(case, rides):
    light, near, speed = CASES[case]
    scene = passing(light, near, speed, rides)
    frames, samples = refined(scene, K, TOLERANCE, tolerance=LN)
    since = np.linspace(0, GAP, 1001)
    truth = np.log(radiance(light, near, speed * (since - GAP / 2) * 1e-9)).reshape(-1, len(since))
    poses = closed_form(scene, np.array([START])).pose[:, 0]
    start = Renderer(scene, scene.cameras[0]).render(poses, None, ("luminance",))["luminance"]
    lit = np.flatnonzero(np.ptp(truth, axis=1) > 1.0)
    assert len(lit) > 10
    seen = np.array([np.ptp(told(frames, samples, start, pixel, since)) for pixel in lit])
    assert np.abs(seen / np.ptp(truth[lit], axis=1) - 1).max() < 0.1


def test_lamps_that_are_gone_between_two_instants_are_counted():
    """Instants are 0.3 ms apart: a beam 2 cm wide at 100 m/s is on a point for 0.2 ms."""
    scene = passing(replace(SPOT, cone=(0.009, 0.01)), 1.0, 100.0, False)
    assert parts_of(scene, K, 300_000)[1]
    assert not parts_of(passing(*CASES["beam 4 cm wide"][:2], 10.0, False), K, 300_000)[1]


def test_a_lamp_that_goes_with_the_camera_is_not_looked_for():
    """The camera sees its light stand still on the wall."""
    scene = passing(POINT, 0.02, 60.0, True)
    riding = passing(POINT, 0.02, 60.0, True)
    camera = [b.name for b in riding.bodies].index("cam0")
    riding.lights[0] = replace(riding.lights[0], body=camera, vector=np.array([0, 0.2, WALL - 0.02]))
    assert parts_of(scene, K, TOLERANCE)[0] > 0
    assert parts_of(riding, K, TOLERANCE) == (0, False)
