"""Stiff and extreme cases of the warp: dense rendering at the sub-frames' own times says what is right."""

from dataclasses import replace

import numpy as np
import pytest

from bench.interpolation import cases
from bench.interpolation.cases import GAP, START, frames_of, moving, plain, scene_of, square, wall
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.interpolator.luminance import luminance_of
from nodes.interpolator.methods import METHODS, reads
from nodes.renderer.renderer import Renderer
from nodes.renderer.supersampling import SupersampledRenderer

NONE = np.zeros(1, np.int32)

RIGHT = [
    "rotation, 120 deg per gap",
    "approach, 50 % per gap",
    "crosses the near plane in mid-gap",
    "wire, 0.5 px wide, 10 px per gap",
    "two things that cross",
    "500 px per gap",
    "sky, camera turns by 10 deg",
    "light that flickers once per gap",
]


@pytest.mark.parametrize("name", [*RIGHT, "plate that turns over and back"])
def test_rigid_is_dense_rendering_where_geometry_alone_changes(name):
    """No pixel off by half a threshold; cubic convolution of a smooth picture leaves hundredths."""
    found = frames_of(cases.CASES[name](), "rigid")
    assert np.isfinite(found.made).all()
    assert found.errors().max() < 0.5
    assert np.sqrt(np.mean(found.errors() ** 2)) < 0.03


@pytest.mark.parametrize("name", RIGHT)
def test_motion_vectors_never_make_nonsense(name):
    """What splat cannot know it takes from a neighbour: finite, and within what the keyframes show."""
    for method in ("splat", "splat-quadratic"):
        found = frames_of(cases.CASES[name](), method, 4)
        assert np.isfinite(found.made).all() and found.made.min() > 0
        assert found.made.max() <= 1.001 * max(1.0, found.truth.max())


def test_where_splat_is_known_to_fail():
    """A straight line is 39 px off a half circle of 37 px, and nothing tells it of what comes and goes in a gap."""
    for name in ("rotation, 120 deg per gap", "crosses the near plane in mid-gap", "light that flickers once per gap"):
        assert np.sqrt(np.mean(frames_of(cases.CASES[name](), "splat").errors() ** 2)) > 1


@pytest.mark.parametrize("name", ["moving shadow", "running highlight"])
def test_light_that_runs_over_a_surface_is_found_in_part_and_counted(name):
    """Shaded anew where the keyframes disagree: less than two thirds of splat's error, at a cost that is told."""
    rigid, splat = (frames_of(cases.CASES[name](), method) for method in ("rigid", "splat"))
    error = [np.sqrt(np.mean(f.errors() ** 2)) for f in (rigid, splat)]
    assert error[0] < error[1] * 2 / 3
    assert 0 < rigid.reshaded < 0.3 * rigid.made.size


def stream(method, places, episodes, upsampling=4, **light):
    """Keyframes of a square that physics puts at one x after another, always in mid-gap: frames and events of gaps."""
    square_path = moving((0, 0, 2.0))
    scene = scene_of([wall(), (square(0.3), plain(0.9), square_path)], **light)
    still = cases.states_of(scene, np.array([START])).pose[0, 0]
    scene.bodies[1].trajectory = None
    view = scene.cameras[0]
    renderer = Renderer(scene, view)
    interpolator = Interpolator(method, upsampling, scene=scene, camera=view)
    sensor = EventSensor(view.height, view.width, threshold=0.2)
    before, made, events = None, [], []
    for k, (x, episode) in enumerate(zip(places, episodes, strict=True)):
        stamp = START + k * GAP
        poses = still.copy()
        poses[1, 0] = x
        again = k > 0 and episode == episodes[k - 1]
        last = before if again else poses
        outputs = {"radiance"} | (reads(method) & {"depth", "motion"})
        images = {n: v.copy() for n, v in renderer.render(poses[None], last[None], outputs, {}, stamp).items()}
        t = np.array([stamp - GAP, stamp - GAP // 2 - 500, stamp - GAP // 2 + 500, stamp])
        path = np.stack([last, last, poses, poses])[None]
        states = States(t, path, np.zeros((*path.shape[:3], 6)))
        t, frames = interpolator.push(
            stamp, NONE + episode, images["radiance"], images.get("depth"), images.get("motion"),
            states=states if "state" in reads(method) else None,
        )  # fmt: skip
        made.append(frames[0].copy())
        events.append(len(sensor.process(frames, t, NONE + episode).t))
        before = poses
    return made, events


@pytest.mark.parametrize("method", METHODS)
def test_a_static_scene_makes_no_event_at_all(method):
    made, events = stream(method, [0.1] * 4, [0] * 4, 8, lights=[cases.lamp()])
    assert events == [0, 0, 0, 0]
    assert all((frames == made[0][0]).all() for frames in made)


@pytest.mark.parametrize("method", METHODS)
def test_a_reset_is_not_warped_and_makes_no_event(method):
    """What is elsewhere after a reset was not on its way there: one frame, the keyframe, and a new reference."""
    made, events = stream(method, [-0.8, -0.8, 0.8, 0.8], [0, 0, 1, 1])
    assert [len(frames) for frames in made] == [1, 1 if method == "none" else 4] * 2
    assert events == [0, 0, 0, 0]
    assert not np.array_equal(made[1][-1], made[2][0])
    assert (made[3] == made[2][0]).all()


def test_a_teleport_within_an_episode_happens_at_once():
    """By the states of physics the square is at its old place until mid-gap and at its new one from then on."""
    made, events = stream("rigid", [-0.8, -0.8, 0.8], [0, 0, 0])
    old, new = made[1][-1], made[2][-1]
    assert not np.array_equal(old, new)
    # The sub-frame at 1/4 is the old picture, that at 3/4 the new one; 1/2 lies in the jump.
    np.testing.assert_allclose(made[2][0], old, rtol=2e-3)
    np.testing.assert_allclose(made[2][2], new, rtol=2e-3)
    assert events[1] == 0 < events[2]


@pytest.mark.parametrize("pixels", [0.3, 1.0, 2.0])
def test_a_thin_wire_keeps_its_share_of_the_light(pixels):
    """Against 16 samples per axis: with 4 samples per axis, moved before they are averaged, the light that the wire
    takes from the wall in a row is right to a sample's width at both edges, at every sub-frame."""
    scene = cases.wire(pixels)
    view = replace(scene.cameras[0], supersampling=4)
    fine = SupersampledRenderer(scene, view, 4, apart=True)
    truth = SupersampledRenderer(scene, view, 16)
    interpolator = Interpolator("rigid", 4, scene=scene, camera=view)
    for k in range(2):
        stamp = START + k * GAP
        t = np.linspace(stamp - GAP, stamp, 11).astype(np.int64)
        states = cases.states_of(scene, t)
        radiance = fine.render(states.pose[:, -1], None, {"radiance"}, {}, stamp)["radiance"].copy()
        t, frames = interpolator.push(stamp, NONE, radiance, None, None, states=states)
    row = cases.HEIGHT // 2
    for i, stamp in enumerate(t.tolist()):
        poses = cases.states_of(scene, np.array([stamp])).pose[:, 0]
        right = luminance_of(truth.render(poses, None, {"radiance"}, {}, stamp)["radiance"].copy(), "cpu").numpy()
        got, wanted = frames[0, i, row].astype(np.float64), right[0, row].astype(np.float64)
        # The wire is 0.27 bright, the wall 0.06 to 0.24: one sample is a quarter of a pixel.
        assert np.abs(got - wanted).sum() < 2 * 0.21 / 4 * 1.2
        assert abs(got.sum() - wanted.sum()) < 0.21 / 4 * 1.2
