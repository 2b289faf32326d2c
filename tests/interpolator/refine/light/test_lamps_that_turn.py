"""Light of lamps that shake, circle or swing and are where they were at every frame, against the closed form."""

from dataclasses import replace

import numpy as np
import pytest
from refine_rig import box, parts_of, refined
from rigid_rig import GAP, START, lamp, plain, pose, quad, world

from evis.scene.motion import Linear, Prescribed, Sinusoid, Spin, Swing
from nodes.renderer.renderer import Renderer

K, WALL, ALBEDO, SKY = 4, 3.0, 0.5, 0.05
TOLERANCE, LN = 20_000, 0.05
PERIODS = 2
"""Of the lamp between two frames: it is where it was halfway too."""
FREQUENCY = PERIODS * K / GAP * 1e9
FORTH = np.array([0.0, 0.0, 1.0])
MOTIONS = {
    "shakes": ((0.0, 0.2, WALL - 0.6), Sinusoid(0.2 * FORTH, FREQUENCY), np.zeros(3)),
    "circles": ((0.0, 0.2, WALL - 0.6), Spin(np.array([0.0, 1.0, 0.0]), 2 * np.pi * FREQUENCY), 0.2 * FORTH),
}


def before_a_wall(light, way, *things):
    """A wall under one lamp, which a body carries this way."""
    scene = world([(quad(6.0), plain(ALBEDO), Prescribed(pose(z=WALL))), *things], spares=[("stand", way)], sky=SKY)
    body = [b.name for b in scene.bodies].index("stand")
    scene.lights.append(replace(light, body=body))
    return scene


def points_of(scene):
    """Where the points of the wall are that pixels see, float64 [h, w, 3] m."""
    view = scene.cameras[0]
    u, v = np.meshgrid(np.arange(view.width), np.arange(view.height))
    x, y = (u - view.k[0, 2]) / view.k[0, 0], (v - view.k[1, 2]) / view.k[1, 1]
    return WALL * np.stack([x, y, np.ones_like(x)], -1)


def told(frames, samples, start, pixel, since):
    """ln I of a pixel at times since START, on lines between its frames and its samples."""
    at, offset, value = samples
    own = at == pixel
    times = np.concatenate([np.arange(K + 1) * GAP / K, offset[own]])
    values = np.concatenate([[start.flat[pixel]], frames.reshape(K, -1)[:, pixel], value[own]])
    order = np.argsort(times, kind="stable")
    return np.interp(since, times[order], np.log(values[order].astype(np.float64)))


@pytest.mark.parametrize("shadows", [True, False])
@pytest.mark.parametrize("how", MOTIONS)
def test_light_of_a_lamp_that_is_back_at_every_frame_is_followed(how, shadows):
    """Irradiance of a point source: I cos / r^2. All frames are alike, and so is what is halfway. What goes up and down
    by less than two tolerances may stay unseen."""
    place, motion, beside = MOTIONS[how]
    path = Prescribed(pose(*place), [motion])
    scene = before_a_wall(replace(lamp(), vector=beside, shadows=shadows), path)
    frames, samples = refined(scene, K, TOLERANCE, tolerance=LN)
    since = np.linspace(0, GAP, 64 * K * PERIODS + 1)
    poses = path.pose((START + since).round().astype(np.int64))
    angle = 2 * np.pi * FREQUENCY * since * 1e-9
    source = np.array(place) + 0.2 * np.stack([0 * angle, 0 * angle, np.sin(angle)], -1)
    if how == "circles":
        source = np.array(place) + 0.2 * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)
        assert np.allclose(poses[:, :3], place)
    way = source - points_of(scene)[..., None, :]
    irradiance = scene.lights[0].colour[0] * -way[..., 2] / np.linalg.norm(way, axis=-1) ** 3
    truth = np.log(ALBEDO * (SKY + irradiance / np.pi)).reshape(-1, len(since))
    assert np.ptp(truth, axis=1).max() > 1.0
    start = Renderer(scene, scene.cameras[0]).render(_poses(scene, START), None, ("luminance",))["luminance"]
    close = [
        np.abs(told(frames, samples, start, pixel, since) - truth[pixel]).max() < 2.5 * LN + 0.05 * np.ptp(truth[pixel])
        for pixel in range(0, len(truth), 97)
    ]
    # Where what is halfway between two turns happens to be on a line, the curve beside it is not looked for.
    assert np.mean(close) > 0.9


def _poses(scene, t):
    """Poses of all bodies at one time, [1, N, 7]."""
    return np.stack([body.trajectory.pose(np.array([t])) for body in scene.bodies], 1)


def beam(swing, frequency):
    """A spot that swings by an angle to both sides [rad]."""
    spot = replace(lamp(), kind="spot", direction=FORTH, cone=(0.19, 0.2), vector=np.zeros(3))
    return before_a_wall(spot, Prescribed(pose(), [Swing(np.array([0.0, 1.0, 0.0]), swing, frequency)]))


def test_a_beam_is_looked_at_three_times_between_two_turns():
    """Its edge goes to and fro over points that it leaves again much sooner than it would cross them as a whole."""
    assert parts_of(beam(0.05, FREQUENCY), K, TOLERANCE) == (16, False)
    assert parts_of(beam(0.05, 20.0), K, TOLERANCE)[0] == 0


def test_a_lamp_that_trembles_or_goes_straight_on_is_not_looked_for():
    near = pose(0, 0.2, WALL - 0.6)
    for motion in (Sinusoid(1e-3 * FORTH, FREQUENCY), Linear(np.array([20.0, 0.0, 0.0])), Sinusoid(0.2 * FORTH, 20.0)):
        assert parts_of(before_a_wall(lamp(), Prescribed(near, [motion])), K, TOLERANCE) == (0, False)


def test_a_lamp_too_fast_to_be_followed_is_counted():
    """Instants are 0.3 ms apart: of each half period there is less than one."""
    scene = before_a_wall(replace(lamp(), vector=np.zeros(3)), Prescribed(pose(0, 0.2, WALL - 0.6), [
        Sinusoid(0.2 * FORTH, 1900.0)]), (box((0.1, 0.1, 0.1)), plain(0.3), Prescribed(pose(0.5, 0, 2.0))))  # fmt: skip
    assert parts_of(scene, K, 300_000)[1]
