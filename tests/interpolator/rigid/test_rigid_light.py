"""`rigid` where light changes, where nothing does, and where an episode begins."""

import numpy as np
import pytest
import warp as wp
from rigid_rig import (
    GAP,
    START,
    Gap,
    camera,
    closed_form,
    cross,
    disc,
    keyframe,
    lamp,
    luminance,
    painted,
    plain,
    pose,
    quad,
    world,
)

from evis.runtime.clock import subframe_stamps
from evis.scene.model import Waveform
from evis.scene.motion import Linear, Prescribed, Sinusoid, Spin
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import KeyframeView
from nodes.interpolator.pixel_means import new_frames
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.interpolator.rigid.layout import MOST_WAVEFORMS, TOLERANCE
from nodes.renderer.renderer import Renderer


def across(speed, at=-0.2, z=2.0):
    """Moves along x so that it is at `at` when the gap begins."""
    return Prescribed(pose(at - speed * START * 1e-9, 0, z), [Linear(np.array([speed, 0.0, 0.0]))])


def wall(z=3.0, material=None):
    mesh = quad(4.0)
    mesh.vertices[:, 2] = z
    return mesh, material or plain(0.6), "world"


def test_where_nothing_changes_every_frame_is_the_keyframe_bit_for_bit():
    scene = world([wall(material=painted()), (disc(0.3), plain(0.2), "world")], lights=[lamp()])
    gap = cross(scene, 8)
    assert (gap.frames == gap.frames[-1]).all()
    assert gap.report.reshaded == gap.report.filled == 0


def test_what_stands_still_beside_what_moves_does_not_change_by_a_bit():
    scene = world([wall(material=painted()), (disc(0.2), plain(0.9), across(20.0))])
    gap = cross(scene, 8)
    still = (gap.dense == gap.dense[-1]).all(0)
    assert (gap.frames[:, still] == gap.frames[-1][still]).all()
    assert still.mean() > 0.5
    assert gap.error().max() < 0.02


def test_a_shadow_that_moves_is_shaded_at_its_own_time():
    """What A and B agree about may still be wrong in between: a shadow that comes and goes within the gap."""
    scene = world([wall(), (disc(0.25), plain(0.5), across(25.0))], lights=[lamp()], sky=0.05)
    gap = cross(scene, 8, splat=True)
    assert gap.report.reshaded > 0
    # LightState or dark in both keyframes and the other way between them, for one pixel in two hundred at most.
    assert (gap.error() > 2 * TOLERANCE).mean() < 0.005
    assert (gap.error() > 2 * TOLERANCE).mean() < 0.2 * (gap.error(gap.splat) > 2 * TOLERANCE).mean()


def test_a_light_that_grows_evenly_is_blended():
    """A lamp that comes closer: the light changes by less than the tolerance, and in truth as 1 / r^2."""
    light = lamp(body=0)
    path = Prescribed(pose(0, -3 + 0.04 * START * 1e-9 * 0, 0), [Sinusoid(np.array([0.0, 0.4, 0.0]), 7.0)])
    scene = world([wall()], lights=[light], spares=[("carrier", path)])
    gap = cross(scene, 8)
    assert gap.error().max() < TOLERANCE / 4
    assert np.abs(np.log(gap.dense[0] / gap.dense[-1])).max() > 0.01


WAVEFORMS = {
    "mains, as strong in both keyframes": [Waveform("sine", 100.0, 0.8, 0.1)],
    "off in between": [Waveform("sine", 50.0, 1.0, 0.25)],
    "not a multiple": [Waveform("sine", 730.0, 0.8, 0.1)],
    "PWM": [Waveform("square", 730.0, 1.0, 0.05, 0.3)],
    "mains and PWM": [Waveform("sine", 100.0, 0.8, 0.1), Waveform("square", 730.0, 1.0, 0.05, 0.3)],
    "three phases": [Waveform("sine", 100.0, 0.9, phase) for phase in (0.0, 1 / 3, 2 / 3)],
    "two of three alike, one steady": [Waveform("sine", 50.0, 1.0, 0.25), None, Waveform("sine", 50.0, 1.0, 0.25)],
}


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("waves", WAVEFORMS.values(), ids=WAVEFORMS)
def test_flickering_lights_are_as_strong_as_they_are_at_every_frame(waves, channels):
    """Only what is uncovered is shaded anew: 10 ms apart keyframes tell nothing of 100 Hz, the waveforms all."""
    lights = [lamp(waveform=wave) for wave in waves]
    for n, light in enumerate(lights[1:], 1):
        # Where each of them is as strong beside the others is another matter on either side of the wall.
        light.vector[0] = -1.5 if n % 2 else 1.5
    scene = world([wall(), (quad(0.3), plain(0.3), across(15.0))], lights=lights)
    gap = cross(scene, 8) if channels == 1 else coloured(scene, 8)
    error = gap.error()
    # Above the quad, and its shadow is below, there is nothing but the wall.
    assert error[:, :20].max() < 1e-5
    # The quad's light changes on its way, by less than is looked for.
    assert error.max() < TOLERANCE / 4
    assert np.ptp(np.log(gap.dense), axis=0).max() > 0.1
    # A part of which is where the quad's shadow under each lamp may be.
    assert 0 < gap.report.reshaded < (0.1 if len(waves) == 1 else 0.3) * gap.report.samples


def coloured(scene, upsampling):
    """`cross` in RGB, of which the luminance is compared."""
    view = scene.cameras[0]
    renderer = Renderer(scene, view)
    views, before = [], None
    for t in (START, START + GAP):
        states = closed_form(scene, np.array([START, t]))
        image = renderer.render(states.pose[:, -1], before, ("radiance",), {}, t)["radiance"].copy()
        views.append(KeyframeView(wp.array(image, device="cpu"), states=states, stamp_ns=t))
        before = states.pose[:, -1]
    out = np.empty((1, upsampling, view.height, view.width, 3), np.float32)
    report = Rigid(scene, view, 1, upsampling, 0, 3).between(*views, [False], out)
    stamps = subframe_stamps(START, START + GAP, upsampling)
    shown = lambda t: renderer.render(closed_form(scene, np.array([t])).pose[:, 0], t_ns=int(t))["radiance"]
    return Gap(luminance(out[0]), np.array([luminance(shown(t))[0] for t in stamps]), report)


def test_lights_that_flicker_in_too_many_ways_are_shaded_at_every_frame():
    waves = [Waveform("sine", 100.0, 0.8, 0.1 + 0.1 * n) for n in range(MOST_WAVEFORMS[False] + 1)]
    scene = world([wall(), (quad(0.3), plain(0.3), across(15.0))], lights=[lamp(waveform=wave) for wave in waves])
    scene.lights[0].vector[0] = 1.0
    gap = cross(scene, 8)
    assert gap.error().max() < 1e-5
    assert np.abs(np.log(gap.dense[1] / gap.dense[4])).max() > 0.1


def test_a_margin_brings_what_enters():
    path = Prescribed(pose(), [Spin(np.array([0.0, 1.0, 0.0]), 6.0)])
    angle = 6.0 * START * 1e-9
    turned = pose(4 * np.sin(angle), 0, 4 * np.cos(angle), (0, angle, 0))
    scene = world([(quad(4.0), painted(1024), "world")], camera_motion=path)
    scene.instances[0].pose = turned
    bare, with_margin = cross(scene, 4), cross(scene, 4, margin=8)
    assert with_margin.report.reshaded < 0.2 * bare.report.reshaded
    assert bare.error().max() < 0.02 and with_margin.error().max() < 0.02


def test_one_and_a_thousand_frames_per_gap():
    scene = world([(disc(0.4), painted(), Prescribed(pose(0, 0, 2), [Spin(np.array([0.0, 0.0, 1.0]), 50.0)]))])
    view = camera(24, 18, 20.0)
    scene.cameras[0] = view
    one = cross(scene, 1)
    np.testing.assert_allclose(one.frames[0], one.dense[0], rtol=1e-6)
    # From MANY_FRAMES on details finer than pixels are looked at as well.
    some, few, many = (cross(scene, k, on_device=True) for k in (12, 4, 1000))
    assert (some.frames[2::3] == few.frames).all()
    for gap in (some, many):
        assert np.sqrt((gap.error() ** 2).mean()) < 0.03
    assert many.error().mean() < some.error().mean()


def keyframes(scene, renderer, stamps, envs=1):
    """Views of several environments, all alike."""
    views, before = [], None
    for k, stamp in enumerate(stamps):
        t = np.array([stamps[max(k - 1, 0)], stamp]) if k else np.array([stamp])
        states = closed_form(scene, t)
        states.pose, states.twist = (np.repeat(a, envs, 0) for a in (states.pose, states.twist))
        views.append(keyframe(renderer, states, before, stamp))
        before = states.pose[:, -1]
    return views


def test_an_environment_that_begins_an_episode_holds_its_keyframe():
    scene = world([(disc(0.4), painted(), across(10.0))])
    renderer = Renderer(scene, scene.cameras[0], 3)
    a, b = keyframes(scene, renderer, [START, START + GAP], 3)
    free, out = np.empty((2, 3, 4, 72, 96), np.float32)
    Rigid(scene, scene.cameras[0], 3, 4).between(a, b, [False] * 3, free)
    Rigid(scene, scene.cameras[0], 3, 4).between(a, b, [False, True, False], out)
    assert (out[1] == b.image.numpy()[1]).all()
    assert (out[[0, 2]] == free[[0, 2]]).all() and (free[0] != free[0, -1]).any()


def test_environments_threads_and_portions_change_no_bit(monkeypatch):
    """Each environment for itself, and together; in one piece and in several; by one thread and by three."""
    from nodes.interpolator.rigid import layout

    scene = world([(disc(0.4), painted(), None), (quad(0.2), plain(0.9), None)], lights=[lamp()])
    view = scene.cameras[0]
    rng = np.random.default_rng(3)
    paths = [[across(rng.uniform(-20, 20), rng.uniform(-0.3, 0.3), 2.0 - 0.3 * n) for n in range(2)] for _ in range(3)]

    def views(envs):
        result, before = [], None
        renderer = Renderer(scene, view, len(envs))
        for t in (np.array([START]), np.array([START, START + GAP])):
            states = closed_form(scene, t)
            states.pose, states.twist = (np.repeat(a, len(envs), 0) for a in (states.pose, states.twist))
            for e, env in enumerate(envs):
                for n in range(2):
                    states.pose[e, :, n], states.twist[e, :, n] = paths[env][n].pose(t), paths[env][n].twist(t)
            result.append(keyframe(renderer, states, before, int(t[-1])))
            before = states.pose[:, -1]
        return result

    def frames(envs, threads=1, **options):
        out = np.empty((len(envs), 6, 72, 96), np.float32)
        report = Rigid(scene, view, len(envs), 6, threads=threads, options=RigidOptions(**options)).between(
            *views(envs), [False] * len(envs), out
        )
        return out, report.reshaded

    together, reshaded = frames([0, 1, 2])
    alone = [frames([e]) for e in range(3)]
    assert all((together[e] == alone[e][0][0]).all() for e in range(3))
    assert reshaded == sum(count for _, count in alone) > 0
    assert (frames([0, 1, 2], threads=3)[0] == together).all()
    # What a GPU does, done here, is what lists of every pixel give.
    monkeypatch.setattr(layout, "STEP_PX", 0.0)
    every = frames([0, 1, 2])[0]
    assert (frames([0, 1, 2], on_device=True)[0] == every).all()
    monkeypatch.setattr(layout, "CPU_PIXELS", 3 * 72 * 96 * 2)
    assert (frames([0, 1, 2])[0] == every).all()


def test_through_the_interpolator_over_several_gaps():
    """Each gap begins with the keyframe that ended the one before; an episode's first keyframe stands alone."""
    scene = world([(disc(0.4), painted(), across(10.0))])
    view = scene.cameras[0]
    renderer, inner = Renderer(scene, view), Renderer(scene, view)
    interpolator = Interpolator("rigid", 4, scene=scene, camera=view)
    stamps = [START + k * GAP for k in range(4)]
    for k, (stamp, episode) in enumerate(zip(stamps, (0, 0, 0, 1))):
        states = closed_form(scene, np.array([stamps[max(k - 1, 0)], stamp]))
        radiance = renderer.render(states.pose[:, -1])["radiance"].copy()
        t, frames = interpolator.push(stamp, np.array([episode]), radiance, None, None, states=states)
        if k in (0, 3):
            assert t.tolist() == [stamp] and frames.shape == (1, 1, 72, 96)
            continue
        assert t.tolist() == subframe_stamps(stamps[k - 1], stamp, 4).tolist()
        for frame, at in zip(frames[0], t):
            truth = luminance(inner.render(closed_form(scene, np.array([at])).pose[:, 0])["radiance"])[0]
            assert np.abs(np.log(frame / truth)).max() < 0.02


def test_colour_is_right_in_every_channel():
    scene = world([wall(), (disc(0.3), plain(0.5), across(20.0))])
    scene.materials[1].albedo = np.array([0.9, 0.3, 0.05])
    view = scene.cameras[0]
    renderer, inner = Renderer(scene, view), Renderer(scene, view)
    interpolator = Interpolator("rigid", 4, scene=scene, camera=view, colour=True)
    for stamp in (START, START + GAP):
        states = closed_form(scene, np.array([START, stamp]))
        radiance = renderer.render(states.pose[:, -1])["radiance"].copy()
        t, frames = interpolator.push(stamp, np.zeros(1, np.int32), radiance, None, None, states=states)
    assert frames.shape == (1, 4, 72, 96, 3)
    for frame, at in zip(frames[0], t):
        truth = inner.render(closed_form(scene, np.array([at])).pose[:, 0])["radiance"][0]
        np.testing.assert_allclose(frame, truth, rtol=1e-5)


def test_a_keyframe_that_is_not_finite_is_counted_and_not_used():
    scene = world([(disc(0.4), painted(), across(10.0))])
    view = scene.cameras[0]
    a, b = keyframes(scene, Renderer(scene, view), [START, START + GAP])
    broken = b.image.numpy()
    broken[0, 30:34, 40:44] = np.nan
    out = np.empty((1, 4, 72, 96), np.float32)
    report = Rigid(scene, view, 1, 4).between(a, b, [False], out)
    assert report.nonfinite == 16
    assert np.isfinite(out[:, :-1]).all()


def test_what_is_missing_is_said_in_one_line():
    scene = world([(disc(0.4), plain(0.5), across(10.0))])
    view, radiance, episodes = scene.cameras[0], np.ones((1, 72, 96, 3), np.float32), np.zeros(1, np.int32)
    with pytest.raises(ValueError, match="rigid interpolator needs the scene"):
        Interpolator("rigid", 4)
    with pytest.raises(ValueError, match="needs the bodies' states"):
        Interpolator("rigid", 4, scene=scene, camera=view).push(0, episodes, radiance, None, None)
    states = closed_form(scene, np.array([0]))
    states.pose = states.pose[:, :, :1]
    with pytest.raises(ValueError, match="the states have 1 bodies, scene test has 2"):
        Interpolator("rigid", 4, scene=scene, camera=view).push(0, episodes, radiance, None, None, states=states)
    with pytest.raises(ValueError, match="96x68 px with a margin of 0 px, camera 'cam0' is 96x72 px"):
        now = closed_form(scene, np.array([0]))
        Interpolator("rigid", 4, scene=scene, camera=view).push(0, episodes, radiance[:, 4:], None, None, states=now)


@pytest.mark.parametrize("method", ["rigid", "splat"])
def test_samples_are_moved_before_they_are_averaged(method):
    """A plain square on its way: a pixel at its edge has the share of its samples, at the sub-frame's own time."""
    scene = world([wall(), (quad(0.3), plain(0.1), across(13.0))])
    view = scene.cameras[0]
    renderer, inner = Renderer(scene, view, margin=2, supersampling=3), Renderer(scene, view, supersampling=3)
    interpolator = Interpolator(method, 4, scene=scene, camera=view)
    before = None
    for stamp in (START, START + GAP):
        states = closed_form(scene, np.array([START, stamp]))
        images = renderer.render(states.pose[:, -1], before, ("radiance", "depth", "motion"))
        images = {name: image.copy() for name, image in images.items()}
        before = states.pose[:, -1]
        given = images["radiance"], images["depth"], images["motion"]
        t, frames = interpolator.push(stamp, np.zeros(1, np.int32), *given, margin=6, states=states)
    assert frames.shape == (1, 4, 72, 96)
    wrong = []
    for frame, at in zip(frames[0], t):
        fine = luminance(inner.render(closed_form(scene, np.array([at])).pose[:, 0])["radiance"])[0]
        truth = fine.reshape(72, 3, 96, 3).mean((1, 3))
        wrong.append(np.abs(np.log(frame / truth)))
    mixed = (truth > 0.031) & (truth < 0.179)
    assert mixed.sum() > 50
    # The warp rounds an edge to whole samples, a third of a pixel; what is shaded at its own time does not.
    assert np.max(wrong) < (1e-5 if method == "rigid" else 1.0)


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize(("method", "samples"), [("rigid", 1), ("rigid", 2), ("splat", 1), ("none", 1)])
def test_arrays_of_a_device_give_the_frames_of_numpy_arrays(method, samples, colour):
    scene = world([wall(), (disc(0.4), painted(), across(10.0))])
    view = scene.cameras[0]
    names = ("radiance", "depth", "motion")
    renderer = Renderer(scene, view, margin=2, supersampling=samples, half=colour)
    pair = [Interpolator(method, 4, scene=scene, camera=view, colour=colour) for _ in range(2)]
    before, pixel = None, wp.vec3 if colour else wp.float32
    for stamp in (START, START + GAP):
        states = closed_form(scene, np.array([START, stamp]))
        images = {name: wp.empty(renderer.shape, dtype=renderer.types[name], device="cpu") for name in names}
        renderer.render(states.pose[:, -1], before, names, images)
        before = states.pose[:, -1]
        results = []
        for interpolator, given in zip(pair, (images, {name: image.numpy() for name, image in images.items()})):
            allocate = (lambda shape: wp.empty(shape[:4], dtype=pixel, device="cpu")) if given is images else new_frames
            arrays = [given[name] for name in names]
            _, frames = interpolator.push(
                stamp, np.zeros(1, np.int32), *arrays, 2 * samples, allocate=allocate, states=states
            )  # fmt: skip
            results.append(frames)
        assert isinstance(results[0], wp.array)
        np.testing.assert_array_equal(results[0].numpy(), results[1])


def test_what_is_black_stays_black_and_its_edge_is_shaded_anew():
    """Half of a moving picture has no light at all. A cubic curve may overshoot by the tolerance beside the step, but
    not fall towards the logarithm of nothing."""
    half = painted()
    half.texture[:, : half.texture.shape[1] // 2] = 0.0
    gap = cross(world([(quad(0.5), half, across(10.0))], sky=0.3), 8)
    black = gap.dense == 0
    assert black.mean() > 0.05
    np.testing.assert_array_equal(gap.frames == 0, black)
    assert np.abs(np.log(gap.frames[~black] / gap.dense[~black])).max() < 2 * TOLERANCE
