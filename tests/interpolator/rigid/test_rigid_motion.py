"""`rigid` against closed forms and dense rendering, under every kind of motion: nothing is assumed to be straight."""

import numpy as np
import pytest
from rigid_rig import (
    FOCAL,
    GAP,
    START,
    camera,
    closed_form,
    cross,
    disc,
    painted,
    plain,
    pose,
    quad,
    wave,
    world,
)

from evis.geometry.distortion import Lens, unproject
from evis.geometry.pinhole import pixel_grid
from evis.runtime.clock import subframe_stamps
from evis.scene.model import Mesh
from evis.scene.motion import Linear, Prescribed, Sinusoid, Spin, Swing
from nodes.interpolator.keyframe import States
from nodes.interpolator.rigid.patches import patches_of

RESAMPLED = 0.02
"""Cubic convolution of `wave`, of 12 px per period at least, and the renderer's own filter of its texture: ln I."""


def spinning(degrees, tilt=0.0, z=2.0):
    rate = np.deg2rad(degrees) / (GAP * 1e-9)
    return Prescribed(pose(0, 0, z, (tilt, 0.0, 0.0)), [Spin(np.array([0.0, 0.0, 1.0]), rate)])


@pytest.mark.parametrize("degrees", [1, 10, 45, 120])
def test_a_disc_that_turns_shows_its_picture_turned(degrees):
    """Closed form: pixel p sees the picture at p turned back by the angle at that time."""
    scene = world([(disc(0.7), painted(), spinning(degrees))])
    gap = cross(scene, splat=True)
    times = subframe_stamps(START, START + GAP, 4)
    k = scene.cameras[0].k
    grid = pixel_grid(96, 72)
    x, y = ((grid[..., i] - k[i, 2]) / FOCAL * 2.0 for i in (0, 1))
    inside = np.hypot(x, y) < 0.7 - 4 * 2.0 / FOCAL
    for frame, t in zip(gap.frames, times):
        angle = -np.deg2rad(degrees) * t / GAP
        u, v = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
        # The environment of 0.3 lights what is white.
        truth = 0.3 * wave(u / 1.4 + 0.5, v / 1.4 + 0.5)
        assert np.abs(np.log(frame / truth))[inside].max() < RESAMPLED
    error, splat = gap.error(), gap.error(gap.splat)
    assert np.sqrt((error**2).mean()) < (0.6 if degrees < 10 else 0.2) * np.sqrt((splat**2).mean())
    assert gap.report.filled == 0


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_a_wall_that_comes_closer(share):
    """By a share of its distance per gap: the picture grows as 1 / z, which no constant motion vector says."""
    speed = -share * 2.0 / (GAP * 1e-9)
    start = pose(0, 0, 2.0 - speed * START * 1e-9)
    scene = world([(quad(4.0), painted(1024), Prescribed(start, [Linear(np.array([0.0, 0.0, speed]))]))])
    gap = cross(scene, margin=2)
    k = scene.cameras[0].k
    grid = pixel_grid(96, 72)
    for i, frame in enumerate(gap.frames):
        z = 2.0 * (1 - share * (i + 1) / 4)
        u, v = ((grid[..., j] - k[j, 2]) / FOCAL * z / 8.0 + 0.5 for j in (0, 1))
        assert np.abs(np.log(frame / (0.3 * wave(u, v)))).max() < RESAMPLED
    assert gap.report.reshaded == 0


def test_a_tilted_disc_on_an_accelerated_path():
    motions = [Spin(np.array([0.0, 0.0, 1.0]), 60.0), Sinusoid(np.array([0.2, 0.1, 0.3]), 20.0)]
    scene = world([(disc(0.5), painted(), Prescribed(pose(0, 0, 2, (0.6, 0, 0)), motions))])
    gap = cross(scene, 8, splat=True)
    assert np.sqrt((gap.error() ** 2).mean()) < 0.1 * np.sqrt((gap.error(gap.splat) ** 2).mean())
    assert gap.error().max() < 0.15


def test_two_things_that_cross_hide_each_other_exactly():
    """Plain ones: each pixel has the brightness of one of three surfaces, and of the right one."""
    away = np.array([6.0, 0.0, 0.0])
    near = Prescribed(pose(-0.3 - 6.0 * START * 1e-9, 0, 1.5), [Linear(away)])
    far = Prescribed(pose(0.3 + 6.0 * START * 1e-9, 0.05, 1.6), [Linear(-away)])
    scene = world([(quad(0.2), plain(0.8), near), (disc(0.25), plain(0.1), far), (quad(5.0), plain(0.4), "world")])
    scene.instances[2].pose = pose(0, 0, 4)
    gap = cross(scene, 8)
    assert gap.error().max() < 1e-5
    assert 0 < gap.report.reshaded + gap.report.samples and gap.report.filled == 0


@pytest.mark.parametrize("width", [0.3, 1.0, 2.0])
def test_a_wire_stays_a_wire(width):
    """Ten pixels per gap; the pixels that it hits are those of a rendering at that time, its picture no wider."""
    speed = 10 * 2.0 / FOCAL / (GAP * 1e-9)
    mesh = quad(1.0)
    mesh.vertices[:, 0] *= width / 2 * 2.0 / FOCAL
    path = Prescribed(pose(-speed * START * 1e-9, 0, 2.0, (0, 0, 0.3)), [Linear(np.array([speed, 0.0, 0.0]))])
    gap = cross(world([(mesh, plain(0.9), path)]), 8)
    assert gap.error().max() < 1e-5
    assert (gap.dense[3] < 0.29).sum() > 5


def test_a_body_that_crosses_the_near_plane_in_mid_gap():
    speed = -2.0 * 0.4 / (GAP * 1e-9)
    path = Prescribed(pose(0.02, 0.0, 0.4 - speed * START * 1e-9), [Linear(np.array([0.0, 0.0, speed]))])
    scene = world([(quad(0.1), plain(0.7), path)], view=camera(near=0.05))
    gap = cross(scene, 8)
    assert np.isfinite(gap.frames).all()
    assert gap.error().max() < 1e-5
    assert (gap.dense[0] < 0.29).any() and not (gap.dense[-1] < 0.29).any()


LENSES = {
    "plumb_bob": (-0.28, 0.09, 1e-3, -5e-4, 0.0),
    "equidistant": (0.02, -0.01, 0.004, -0.001),
}


@pytest.mark.parametrize("model", LENSES)
def test_a_moving_camera_with_a_lens(model):
    """The camera turns and moves before a painted wall; closed form through the inverse of the lens."""
    view = camera(model=model, coefficients=LENSES[model])
    motions = [Spin(np.array([0.0, 0.6, 0.8]), 20.0), Linear(np.array([2.0, 0.0, 4.0]))]
    seconds = START * 1e-9
    path = Prescribed(pose(-2.0 * seconds, 0, -4.0 * seconds), motions)
    path.turns[0] = Spin(np.array([0.0, 0.0, 1.0]), 20.0)
    scene = world([(quad(6.0), painted(1024), "world")], view=view, camera_motion=path)
    scene.instances[0].pose = pose(0, 0, 2)
    gap = cross(scene, 4, margin=6)
    lens = Lens.of(model, LENSES[model])
    rays = unproject(view.k, lens, pixel_grid(96, 72))
    for frame, t in zip(gap.frames, subframe_stamps(START, START + GAP, 4)):
        from evis.geometry import se3

        at = path.pose(np.array([t]))[0]
        d = se3.rotate(at[3:], rays)
        point = at[:3] + d * ((2.0 - at[2]) / d[..., 2])[..., None]
        truth = 0.3 * wave(point[..., 0] / 12 + 0.5, point[..., 1] / 12 + 0.5)
        assert np.abs(np.log(frame / truth)).max() < RESAMPLED
    assert gap.report.reshaded < 0.1 * gap.report.samples


def test_the_sky_turns_with_the_camera_and_does_not_move_with_it():
    scene = world([], camera_motion=Prescribed(pose(), [Spin(np.array([0.0, 1.0, 0.0]), 8.0)]))
    angle = 2 * np.pi * (np.arange(256) + 0.5) / 256
    rows = np.pi * (np.arange(128) + 0.5) / 128
    sky = 1.0 + 0.4 * np.sin(9 * angle)[None] * np.cos(7 * rows)[:, None]
    scene.environment_map = np.repeat(sky[..., None], 3, -1).astype(np.float32)
    turned = cross(scene, 4, margin=10)
    assert turned.error().max() < RESAMPLED
    assert np.abs(np.log(turned.dense[0] / turned.dense[-1])).max() > 0.1
    scene.bodies[0].trajectory = Prescribed(pose(), [Linear(np.array([50.0, 3.0, 9.0]))])
    moved = cross(scene, 4)
    assert (moved.frames == moved.frames[-1]).all() and moved.report.reshaded == 0


def test_an_impact_in_mid_gap():
    """A body that physics moves: at a constant speed until it bounces at 40 % of the gap, with a sub-step there."""
    hit = START + 4 * GAP // 10

    def states(scene, t):
        result = closed_form(scene, t)
        s = (t - hit) * 1e-9
        result.pose[0, :, 0, 0] = np.where(s < 0, 20.0, -10.0) * s
        result.pose[0, :, 0, 2] = 2.0
        result.twist[0, :, 0, 0] = np.where(s < 0, 20.0, -10.0)
        return result

    gap = cross(world([(quad(0.3), plain(0.8), None)]), 10, states=states)
    # The sub-step that ends at the impact has one end speed of after it: h / 8 of the jump, 1.25e-4 * 30 m.
    assert (gap.error() > 1e-5).mean() < 0.002
    free = cross(world([(quad(0.3), plain(0.8), None)]), 10, states=states)
    assert (free.frames == gap.frames).all()


def test_poses_come_from_the_sub_steps_and_not_from_the_keyframes():
    """A whole turn and a half within the gap: both keyframes alone say half a turn."""
    turn = Prescribed(pose(0, 0, 2), [Spin(np.array([0.0, 0.0, 1.0]), 3 * np.pi / (GAP * 1e-9))])

    def states(scene, t):
        result = closed_form(scene, t)
        result.pose[0, :, 0], result.twist[0, :, 0] = turn.pose(t), turn.twist(t)
        return States(result.t, result.pose, result.twist)

    mesh = quad(0.5)
    mesh.vertices[:, 0] += 0.3
    gap = cross(world([(mesh, plain(0.9), None)]), 7, states=states)
    assert gap.error().max() < 1e-5


def helix(turns=3, pitch=0.25, radius=0.35, width=0.18, steps=240):
    """A strip wound about the y axis, smooth, so that one piece of surface hides and uncovers parts of itself."""
    angle = np.linspace(0, 2 * np.pi * turns, steps + 1)
    y = pitch * (angle / (2 * np.pi) - turns / 2)
    rim = np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], -1)
    vertices = np.stack([rim, rim + np.array([0, width, 0])], 1).reshape(-1, 3).astype(np.float32)
    i = 2 * np.arange(steps)[:, None]
    faces = np.concatenate([i + np.array([0, 1, 2]), i + np.array([1, 3, 2])]).astype(np.int32)
    along = np.repeat(np.linspace(0, 1, steps + 1), 2)
    uv = np.stack([along, np.tile([0.0, 1.0], steps + 1)], -1).astype(np.float32)[faces]
    return Mesh(vertices, faces, uv)


def test_a_part_is_not_mistaken_for_another_of_the_same_surface():
    """The front of a winding passes before its back; both are one patch, and tell apart by their distance alone."""
    spin = Prescribed(
        pose(0, 0, 1.6, (0.4, 0, 0)), [Spin(np.array([0.0, 1.0, 0.0]), 40.0), Swing(np.eye(3)[0], 0.8, 9.0)]
    )
    material = painted(256)
    gap = cross(world([(helix(), material, spin)]), 8, splat=True)
    assert patches_of(world([(helix(), material, spin)]))[1] == 2, "the sky and one patch"
    assert (gap.error() > 0.15).mean() < 0.002
    assert (gap.error(gap.splat) > 0.15).mean() > 0.01
