"""Samples of single pixels between the frames: their values against frames there, their times against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from refine_rig import box, refined, tumbling
from rigid_rig import (
    FOCAL,
    GAP,
    START,
    camera,
    closed_form,
    disc,
    lamp,
    luminance,
    painted,
    plain,
    pose,
    quad,
    world,
)

from evis.runtime.clock import subframe_stamps
from evis.scene.model import Material, Waveform
from evis.scene.motion import Linear, Prescribed, Spin
from nodes.renderer.renderer import Renderer


def test_an_instant_has_what_a_frame_then_would_have():
    """Instants are the frames of 8 times as many, but for the rounding of depths; where one surface gives way to
    another, samples have the values of the instant before or after."""
    scene = tumbling()
    _, (pixels, ns, values) = refined(scene, 4, GAP / 4 / 8 * 1.01)
    poses = closed_form(scene, np.array([START])).pose[:, 0]
    first = luminance(Renderer(scene, scene.cameras[0]).render(poses, t_ns=START)["radiance"])
    frames = np.concatenate([first.reshape(1, -1), refined(scene, 32, 0)[0].reshape(32, -1)])
    stamps = np.concatenate([[0], subframe_stamps(0, GAP, 32)])
    before = np.searchsorted(stamps, ns, side="right") - 1
    on_time = stamps[before] == ns
    assert on_time.sum() > 1000 and (before[on_time] % 8 > 0).all()
    apart = [np.abs(np.log(values / frames[i, pixels])) for i in (before, np.minimum(before + 1, 32))]
    # On an edge a pixel may see either side.
    assert (apart[0][on_time] > 3e-6).mean() < 0.001
    assert (np.minimum(*apart)[~on_time] > 3e-6).mean() < 0.005


def errors_of(scene, **how):
    """|ln I - ln I_true| of further samples, the truth rendered at every third instant."""
    _, (pixels, ns, values) = refined(scene, 4, 50_000, **how)
    renderer = Renderer(scene, scene.cameras[0])
    errors = []
    for t in np.unique(ns)[::3].tolist():
        pose_then = closed_form(scene, np.array([START + t])).pose[:, 0]
        dense = luminance(renderer.render(pose_then, t_ns=START + t)["radiance"]).reshape(-1)
        here = ns == t
        errors.append(np.log(values[here] / dense[pixels[here]]))
    return np.abs(np.concatenate(errors))


def test_values_are_those_of_dense_rendering():
    errors = errors_of(tumbling())
    assert len(errors) > 1000
    assert np.median(errors) < 0.01 and np.quantile(errors, 0.99) < 0.1


def test_values_through_a_lens():
    errors = errors_of(tumbling(view=camera(model="equidistant", coefficients=(0.02, -0.01, 0.0, 0.0))))
    assert len(errors) > 1000
    assert np.median(errors) < 0.02 and np.quantile(errors, 0.98) < 0.1


def test_values_under_a_lamp_that_flickers():
    """On what does not turn against it: elsewhere frames are as far off."""
    lights = [lamp(waveform=Waveform("sine", 400.0, 0.6))]
    flight = Prescribed(pose(-5.0 * START * 1e-9, 0, 2.0), [Linear(np.array([5.0, 0.0, 0.0]))])
    things = [(quad(4.0), painted(1024), Prescribed(pose(z=3.0))), (quad(0.3), plain(0.9), flight)]
    errors = errors_of(world(things, lights=lights))
    assert len(errors) > 10_000
    assert np.median(errors) < 0.005 and np.quantile(errors, 0.98) < 0.1


PULSES = Waveform("square", 700.0, 0.8, 0.1, 0.3)
BESIDE = [replace(PULSES, frequency=hz, phase=0.2 * n) for n, hz in enumerate((530.0, 610.0, 830.0))]


@pytest.mark.parametrize(
    ("waves", "most"),
    [([PULSES, None], 0.03), ([PULSES, Waveform("sine", 330.0, 0.6)], 0.07), ([PULSES, *BESIDE], 0.03)],
    ids=["one", "two", "four"],
)
def test_lamps_that_are_switched_many_times_between_frames(waves, most):
    """ln I is a line between a pixel's samples: against dense rendering at times of its own, beside a disc that turns.
    Of several lamps each flickers in its own way; four of them are switched after one another within 0.2 ms. A sine is
    followed to 0.8 of the tolerance, here of 0.1."""
    lights = [replace(lamp(waveform=w), name=f"lamp{n}") for n, w in enumerate(waves)]
    turn = Spin(np.array([0.0, 0.0, 1.0]), 20.0)
    things = [(quad(4.0), painted(), Prescribed(pose(z=3.0))), (disc(0.4), plain(0.7), Prescribed(pose(z=2.5), [turn]))]
    scene = world(things, lights=lights)
    frames, (pixels, ns, values) = refined(scene, 4, 100_000)
    renderer = Renderer(scene, scene.cameras[0])
    dense = {}
    for t in np.random.default_rng(1).integers(0.26 * GAP, GAP, 60).tolist():
        # It may be a lamp's switch that is looked at: then either side is right.
        around = [
            luminance(renderer.render(at.pose[:, 0], t_ns=START + s)["radiance"]).reshape(-1)
            for s in (t - 15_000, t, t + 15_000)
            for at in [closed_form(scene, np.array([START + s]))]
        ]
        dense[t] = np.log(np.array(around))
    stamps = subframe_stamps(0, GAP, 4)
    errors = []
    for q in range(0, frames[0].size, 53):
        mine = pixels == q
        times, lit = np.concatenate([stamps, ns[mine]]), np.concatenate([frames.reshape(4, -1)[:, q], values[mine]])
        order = np.argsort(times)
        for t, near in dense.items():
            found = np.interp(t, times[order], np.log(lit[order]))
            errors.append(max(near[:, q].min() - found, found - near[:, q].max(), 0.0))
    assert len(errors) > 5000
    assert np.quantile(errors, 0.98) < most


@pytest.mark.parametrize("motions", [(), (Linear(np.array([0.5, 0.0, 0.0])),)], ids=["still", "moving camera"])
def test_a_lamp_that_flickers_where_nothing_else_changes_light(motions):
    """A matte wall is as bright as sky and lamp make it together: closed form, by the lamp's sine alone."""
    lamps = [lamp(waveform=Waveform("sine", 200.0, 0.6))]
    things = [(quad(9.0), plain(0.8), Prescribed(pose(z=3.0)))]
    scene = world(things, camera_motion=Prescribed(pose(), motions), lights=lamps)
    _, (pixels, ns, values) = refined(scene, 4, 100_000)
    assert len(ns) > 5000
    times = np.unique(ns)[::4]
    for t in times.tolist():
        poses, here = closed_form(scene, np.array([START + t])).pose[:, 0], ns == t
        alone = []
        for lights in ([], [replace(lamps[0], waveform=None)]):
            bare = replace(scene, lights=lights)
            alone.append(luminance(Renderer(bare, bare.cameras[0]).render(poses)["radiance"]).reshape(-1)[pixels[here]])
        strength = 1 + 0.6 * np.sin(2 * np.pi * 200.0 * 1e-9 * (START + t))
        np.testing.assert_allclose(values[here], alone[0] + strength * (alone[1] - alone[0]), rtol=0.005)


def test_a_sine_is_sampled_where_it_turns():
    """Events that a lamp makes at the end of its swing are lost where lines pass below its height: 16 % of them at a
    depth of 0.3 and 0.3 ms, of which the closed form has all."""
    scene = world(
        [(quad(9.0), plain(0.8), Prescribed(pose(z=3.0)))], lights=[lamp(waveform=Waveform("sine", 200.0, 0.3))]
    )
    _, (pixels, _, values) = refined(scene, 4, 300_000)
    still = closed_form(scene, np.array([0])).pose[:, 0]
    alone = []
    for lights in ([], [replace(scene.lights[0], waveform=None)]):
        bare = replace(scene, lights=lights)
        alone.append(luminance(Renderer(bare, bare.cameras[0]).render(still)["radiance"]).reshape(-1))
    for q in np.unique(pixels)[::50]:
        course, swing = values[pixels == q], 0.3 * (alone[1] - alone[0])[q]
        np.testing.assert_allclose([course.min(), course.max()], alone[1][q] + [-swing, swing], rtol=0.003)


@pytest.mark.parametrize("apart_ns", [60_000, 90_000, -70_000])
def test_light_between_two_switches_that_follow_closely(apart_ns):
    """One lamp goes on as another of the same strength goes off, or the other way around: a pixel has the light of
    both, or of none, for `apart_ns` meanwhile, with samples 0.5 ms apart for what else there is. Closed form."""
    rates, duty, depth = (250.0, 230.0), 0.5, 0.9
    meet = START + 0.4 * GAP
    phases = [-meet * 1e-9 * rates[0], 0.5 - (meet + apart_ns) * 1e-9 * rates[1]]
    waves = [Waveform("square", rate, depth, phase, duty) for rate, phase in zip(rates, phases)]
    lights = [replace(lamp(waveform=w), name=f"lamp{n}") for n, w in enumerate(waves)]
    scene = world([(quad(9.0), plain(0.8), Prescribed(pose(z=3.0)))], lights=lights)
    _, (pixels, ns, values) = refined(scene, 4, 500_000)
    rest, alone = closed_form(scene, np.array([0])).pose[:, 0], []
    for given in ([], [replace(lights[0], waveform=None)]):
        bare = replace(scene, lights=given)
        alone.append(luminance(Renderer(bare, bare.cameras[0]).render(rest)["radiance"]).reshape(-1))
    sky, one = alone[0], alone[1] - alone[0]
    strength = 2.0 * (1 + depth) if apart_ns > 0 else 2.0 * (1 - depth)
    middle = 0.4 * GAP + apart_ns / 2
    for q in np.unique(pixels)[::50]:
        mine = pixels == q
        found = np.interp(middle, ns[mine], np.log(values[mine]))
        np.testing.assert_allclose(found, np.log(sky[q] + strength * one[q]), atol=0.02)


def test_a_flash_of_ten_microseconds_is_seen():
    """A strobe's flash is a ten thousandth of its period, once in the gap: every pixel has its strength, 10,000 times
    the mean."""
    flash = Waveform("square", 10.0, 1.0, -10.0 * 1e-9 * (START + 0.4 * GAP), 1e-4)
    scene = world([(quad(9.0), plain(0.8), Prescribed(pose(z=3.0)))], lights=[lamp(waveform=flash)])
    _, (pixels, _, values) = refined(scene, 8, 100_000)
    rest, alone = closed_form(scene, np.array([0])).pose[:, 0], []
    for lights in ([], [replace(scene.lights[0], waveform=None)]):
        bare = replace(scene, lights=lights)
        alone.append(luminance(Renderer(bare, bare.cameras[0]).render(rest)["radiance"]).reshape(-1))
    brightest = np.zeros(alone[0].size)
    np.maximum.at(brightest, pixels, values)
    np.testing.assert_allclose(brightest, alone[0] + 1e4 * (alone[1] - alone[0]), rtol=0.01)


@pytest.mark.parametrize("depth", [0.3, 0.9])
def test_a_wall_under_lamps_that_flicker_out_of_step(depth):
    """Each pixel's course is a sum of sines, and samples of what stands still are on it: that of a wall under lamps of
    the three phases of a grid, which make up for each other in part, and a quad that flies past elsewhere."""
    lights = [lamp(waveform=Waveform("sine", 200.0, depth, phase)) for phase in (0.0, 1 / 3, 2 / 3)]
    for n, light in enumerate(lights):
        light.vector[0] = 2.0 * (n - 1)
    flight = Prescribed(pose(-15.0 * START * 1e-9, -0.2, 2.0), [Linear(np.array([15.0, 0.0, 0.0]))])
    scene = world([(quad(4.0), plain(0.8), Prescribed(pose(z=3.0))), (quad(0.2), plain(0.3), flight)], lights=lights)
    frames, (pixels, ns, values) = refined(scene, 4, 100_000)
    rest = closed_form(scene, np.array([0])).pose[:, 0]
    alone = []
    for light in (None, *lights):
        scene.lights = [replace(light, waveform=None)] if light else []
        alone.append(luminance(Renderer(scene, scene.cameras[0]).render(rest)["radiance"]).reshape(-1))
    sky = alone.pop(0)
    sine = lambda t, n: 1 + depth * np.sin(2 * np.pi * (200.0 * 1e-9 * (START + t) + n / 3))
    truth = lambda q, t: sky[q] + sum((alone[n] - sky)[q] * sine(t, n) for n in range(3))
    width = frames.shape[2]
    # Above the quad, whose shadows are lower still.
    above = pixels < width * 12
    assert above.sum() > 3000
    np.testing.assert_allclose(values[above], truth(pixels[above], ns[above].astype(float)), rtol=2e-5)
    stamps, times = subframe_stamps(0, GAP, 4), np.linspace(0.26 * GAP, GAP, 800)
    for q in range(5, width * 12, 97):
        mine = pixels == q
        t, lit = np.concatenate([stamps, ns[mine]]), np.concatenate([frames.reshape(4, -1)[:, q], values[mine]])
        order = np.argsort(t)
        found = np.interp(times, t[order], np.log(lit[order]))
        assert np.abs(found - np.log(truth(q, times))).max() < 0.04


@pytest.mark.parametrize("speed", [10.0, 20.0, -8.0])
def test_a_silhouette_passes_a_pixel_when_it_should(speed):
    """The edge of a square that flies past at `speed` m/s, 2 m away: the time at every pixel that it reaches."""
    start = pose(-speed * START * 1e-9 - np.sign(speed) * 0.5, 0, 2.0)
    square = quad(0.3)
    flight = Prescribed(start, [Linear(np.array([speed, 0.0, 0.0]))])
    scene = world([(quad(4.0), plain(0.2), Prescribed(pose(z=3.0))), (square, plain(0.9), flight)])
    tolerance = 100_000
    frames, (pixels, ns, values) = refined(scene, 8, tolerance)
    h, w = frames.shape[1:]
    k = scene.cameras[0].k
    edge = -0.5 * np.sign(speed) + 0.3 * np.sign(speed)
    row = h // 2
    checked, off = 0, []
    for x in range(w):
        crossing = ((x - k[0, 2]) / FOCAL * 2.0 - edge) / speed * 1e9
        if not 0.02 * GAP < crossing < 0.98 * GAP:
            continue
        mine = pixels == row * w + x
        t = np.concatenate([subframe_stamps(0, GAP, 8), ns[mine]])
        bright = np.concatenate([frames[:, row, x], values[mine]]) > 0.15
        before, after = t[~bright & (t < crossing + GAP / 8)], t[bright & (t > crossing - GAP / 8)]
        if not len(after):
            continue
        low, high = before[before <= after.min()].max(initial=0), after.min()
        assert high - low <= 2 * tolerance + 1
        # A change is told to a 64th of the time between two instants.
        assert low - 2500 <= crossing <= high + 2500
        if 2 * tolerance < crossing % (GAP / 8) < GAP / 8 - 2 * tolerance:
            off.append(abs((low + high) / 2 - crossing))
        checked += 1
    assert checked >= 0.8 * abs(speed) * GAP * 1e-9 * FOCAL / 2.0 - 1
    # The edge itself is followed: only beside a frame its time is not known better than the tolerance.
    assert off and max(off) < 0.05 * tolerance


def test_times_ascend_between_the_frames_and_threads_change_nothing():
    one, two = (refined(tumbling(), 4, 100_000, threads=n)[1] for n in (1, 2))
    for a, b in zip(one, two):
        assert np.array_equal(a, b)
    pixels, ns, values = one
    same = np.diff(pixels) == 0
    assert (np.diff(ns)[same] > 0).all() and (ns > 0).all() and (ns < GAP).all()
    assert not np.isin(ns, subframe_stamps(0, GAP, 4)).any()
    assert np.isfinite(values).all()


def test_many_short_windows_that_are_cut_often():
    """16 frames, each interval of which is halved up to ten times."""
    pixels, ns, values = refined(tumbling(), 16, 300)[1]
    assert len(pixels) > 1000 and np.isfinite(values).all() and (np.diff(ns)[np.diff(pixels) == 0] > 0).all()


def test_what_does_not_change_has_no_samples():
    scene = world([(quad(4.0), painted(), Prescribed(pose(z=3.0)))])
    assert refined(scene, 4, 100_000)[1] is None


def test_an_environment_that_begins_an_episode_has_none():
    assert refined(tumbling(), 4, 100_000, held=True)[1] is None


def test_a_margin_changes_no_time():
    """What enters the image is looked up in the margin, so values differ a little, and where samples are hardly: 4 of
    19,680 did."""
    pairs = [set(zip(*(a.tolist() for a in refined(tumbling(), 4, 100_000, margin=m)[1][:2]))) for m in (0, 8)]
    assert min(map(len, pairs)) > 10_000 and len(pairs[0] ^ pairs[1]) < 0.001 * len(pairs[0])


def test_a_pole_between_two_frames_is_not_missed():
    """It goes by 20 px from frame to frame, 5 from probe to probe, and covers a pixel for width over speed."""
    speed, half = 200.0, 0.04
    start = pose(-speed * (START + GAP / 2) * 1e-9, 0, 2.0)
    pole = Prescribed(start, [Linear(np.array([speed, 0.0, 0.0]))])
    scene = world([(quad(4.0), plain(0.2), Prescribed(pose(z=3.0))), (box((half, 2.0, half)), plain(0.9), pole)])
    frames, (pixels, ns, values) = refined(scene, 4, 20_000)
    height, width = frames.shape[1:]
    row = height // 2
    unseen, found = 0, []
    for x in range(4, width - 4):
        if (frames[:, row, x] > 0.15).any():
            continue
        unseen += 1
        bright = np.sort(ns[(pixels == row * width + x) & (values > 0.15)])
        if len(bright):
            found.append(bright[-1] - bright[0])
    assert unseen > 20
    # A probe finds it where it stands then: 3.2 of every 5 px, and the sides of a box are seen too.
    assert len(found) > 0.5 * unseen
    nearest = 2.0 - half
    assert np.median(found) == pytest.approx(2 * half / speed * 1e9 * 2.0 / nearest, abs=6 * 20_000)


@pytest.mark.gpu
def test_a_gpu_finds_the_same_samples():
    """But for intervals that differ by about what has them cut, and pixels on an edge."""
    scene = tumbling()
    here, there = ({(q, t): v for q, t, v in zip(*refined(scene, 4, 50_000, device=d)[1])} for d in ("cpu", "cuda"))
    both = here.keys() & there.keys()
    assert len(both) > 0.98 * max(len(here), len(there))
    apart = np.array([abs(np.log(here[key] / there[key])) for key in both])
    assert (apart > 1e-3).mean() < 0.005


def test_stripes_that_look_alike_at_all_frames():
    """A wall of stripes, parallel to the image, goes by one of their periods from frame to frame: where it is as far
    and as bright as before, it has moved all the same."""
    period = 0.25
    at = (np.arange(1024) + 0.5) / 1024 * 8.0
    row = np.where(at % period < period / 2, 0.8, 0.2).astype(np.float32)
    stripes = Material("stripes", np.ones(3), np.tile(row[None, :, None], (8, 1, 3)), two_sided=True)
    speed = period / (GAP / 4 * 1e-9)
    flight = Prescribed(pose(-speed * START * 1e-9, 0, 3.0), [Linear(np.array([speed, 0.0, 0.0]))])
    scene = world([(quad(4.0), stripes, flight)])
    frames, (pixels, ns, values) = refined(scene, 4, 50_000)
    assert (np.ptp(frames[:, 20:50, 40:60], axis=0) < 1e-6).mean() > 0.5
    here = np.zeros(frames[0].shape, bool)
    here[20:50, 40:60] = True
    for pixel in np.flatnonzero(here)[::5]:
        mine = pixels == pixel
        seen = values[mine][np.argsort(ns[mine])]
        # It sees each of four bright and four dark stripes.
        assert np.count_nonzero(np.diff((seen > 0.15).astype(int))) >= 7


def test_a_shadow_that_comes_and_goes_between_two_frames():
    """A strip beside the view passes a lamp: its shadow is on pixels for half of the time from one frame to the next,
    around the middle, and on none of them at any frame."""
    each = GAP / 4 * 1e-9
    wide = 0.04
    # The shadow is five times as wide as the strip, and as fast.
    speed = wide / (0.5 * each)
    begin = -speed * (START * 1e-9 + 1.5 * each)
    flight = Prescribed(pose(begin, -0.8, 0.6), [Linear(np.array([speed, 0.0, 0.0]))])
    strip = quad(wide / 2)
    things = [(quad(4.0), plain(0.5), Prescribed(pose(z=3.0))), (strip, plain(0.2), flight)]
    scene = world(things, lights=[lamp()])
    frames, (pixels, ns, values) = refined(scene, 4, 50_000)
    renderer = Renderer(scene, scene.cameras[0])
    stamps = START + np.linspace(1, 2, 41)[1:-1] * GAP / 4
    poses = [closed_form(scene, np.array([round(t)])).pose[:, 0] for t in stamps]
    dark = np.array([luminance(renderer.render(p)["radiance"])[0] < 0.5 * frames[0] for p in poses])
    passed = dark[len(stamps) // 2] & (np.ptp(frames, axis=0) < 0.01 * frames[0])
    assert passed.sum() >= 20
    for pixel in np.flatnonzero(passed):
        mine = pixels == pixel
        order = np.argsort(ns[mine])
        shaded = ns[mine][order][values[mine][order] < 0.5 * frames[0].ravel()[pixel]]
        # It is dark from 1.25 to 1.75 frames on, but for what the pixel's place adds.
        truth = stamps[dark[:, pixel // dark.shape[2], pixel % dark.shape[2]]] - START
        assert abs(shaded.min() - truth.min()) < 0.05 * GAP / 4 and abs(shaded.max() - truth.max()) < 0.05 * GAP / 4


def test_a_wall_that_comes_so_fast_that_its_depth_alone_tells_of_another():
    """Where two triangles meet a pixel shows one after the other, at depths that are not those of one surface from
    one look to the next; it is one all the same, and what is painted on it passes pixels."""
    at = (np.arange(512) + 0.5) / 512 * 8.0
    stripes = np.where(np.sin(2 * np.pi * at / 0.5) > 0, 0.8, 0.2)
    picture = np.sqrt(stripes[None] * stripes[:, None]).astype(np.float32)
    paint = Material("checks", np.ones(3), np.repeat(picture[..., None], 3, -1), two_sided=True)
    speed = 100.0
    flight = Prescribed(pose(1.0, 0.0, 3.0 + speed * START * 1e-9), [Linear(np.array([0.0, 0.0, -speed]))])
    scene = world([(quad(4.0), paint, flight)])
    frames, (pixels, ns, values) = refined(scene, 2, 20_000)
    height, width = frames.shape[1:]
    renderer = Renderer(scene, scene.cameras[0])
    stamps = START + np.linspace(0, 1, 81)[1:-1] * GAP
    states = [closed_form(scene, np.array([round(t)])).pose[:, 0] for t in stamps]
    dense = np.array([luminance(renderer.render(p)["radiance"])[0] for p in states])
    first = luminance(renderer.render(closed_form(scene, np.array([START])).pose[:, 0])["radiance"])[0]
    # The seam of both triangles, from one corner of the quad to the other, goes over these.
    k, wrong = scene.cameras[0].k, []
    for y, x in np.ndindex(height, width):
        across, down = (x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1]
        side = [across * z - 1.0 - down * z for z in (3.0, 2.0)]
        if side[0] * side[1] > 0:
            continue
        mine = pixels == y * width + x
        t = np.concatenate([[0], np.arange(1, 3) * GAP / 2, ns[mine]])
        seen = np.log(np.concatenate([[first[y, x]], frames[:, y, x], values[mine]]))
        order = np.argsort(t)
        known = np.interp(stamps - START, t[order], seen[order])
        wrong.append(np.abs(known - np.log(dense[:, y, x])).mean())
    assert len(wrong) > 300
    # Without samples it is 0.09 and 0.16.
    assert np.median(wrong) < 0.03 and np.percentile(wrong, 95) < 0.06
