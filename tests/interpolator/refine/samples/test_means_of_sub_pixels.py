"""Samples of pixels that are the mean of several: merged from those of their sub-pixels."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from bench.interpolation import extremes
from bench.interpolation.pipeline import Sensors
from evis.events.measure.distance import victor_purpura
from evis.runtime.clock import NS, keyframe_count, keyframe_stamp
from evis.scene import load_scene
from nodes.interpolator.auto.setting import LIGHT
from nodes.interpolator.auto.world import World
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.interpolator.refine.samples.mean_kernels import Division, make_merge, make_subpixel_light
from nodes.renderer.supersampling import SupersampledRenderer

RATE, GAPS = 30.0, 2
TOLERANCE, FINEST = 0.005, 10
ENVS, HEIGHT, WIDTH, FINENESS, COARSE, EACH, MARGIN = 3, 2, 3, 2, 2, 4, 1
LENGTH = 200_000


def lists(draw, channels):
    """Light at the start and at the frames, and samples of 24 sub-pixels per environment: some are constant, some
    black, some drift and some jump within 20 ns."""
    rows, columns = HEIGHT * FINENESS, WIDTH * FINENESS
    tail = (3,) if channels == 3 else ()
    image = draw.uniform(0.05, 2, (ENVS, rows + 2 * MARGIN, columns + 2 * MARGIN, *tail))
    frames = draw.uniform(0.05, 2, (ENVS * COARSE, rows, columns, *tail))
    inner = image[:, MARGIN:-MARGIN, MARGIN:-MARGIN]
    samples = []
    for p in range(ENVS * rows * columns):
        e, y, x = np.unravel_index(p, (ENVS, rows, columns))
        kind = draw.integers(4)
        if kind < 2:
            inner[e, y, x] = frames[e * COARSE : (e + 1) * COARSE, y, x] = 0.7 * kind
        times = np.sort(draw.choice(np.arange(1000, LENGTH, 1000), 3, replace=False)) if kind > 1 else np.zeros(0, int)
        times = times[times != LENGTH // 2]
        if kind == 3:
            times = np.sort(np.concatenate([times, times + 20]))
        samples.append((times.astype(np.int32), draw.uniform(0.05, 2, (len(times), *tail)).astype(np.float32)))
    first = np.cumsum([0, *(len(t) for t, _ in samples)]).astype(np.int32)
    return image.astype(np.float32), frames.astype(np.float32), first, samples


def merged(image, frames, first, samples, held, channels):
    """What the kernel makes of them: places, instants, means."""
    pixel = wp.float32 if channels == 1 else wp.vec3
    division = Division()
    for name, number in {
        "fineness": FINENESS, "height": HEIGHT, "width": WIDTH, "coarse": COARSE, "each": EACH, "finest": FINEST,
        "margin": MARGIN, "tolerance": TOLERANCE,
    }.items():  # fmt: skip
        setattr(division, name, number)
    since = np.tile(np.arange(1, COARSE * EACH + 1) * (LENGTH // (COARSE * EACH)), (ENVS, 1)).astype(np.int32)
    given = [wp.array(a, dtype=t, device="cpu") for a, t in ((held, wp.int32), (since, wp.int32))]
    known = make_subpixel_light(channels)()
    known.image_a, known.frames = (wp.array(a, dtype=pixel, device="cpu") for a in (image, frames))
    known.first = wp.array(first, dtype=wp.int32, device="cpu")
    known.offset = wp.array(np.concatenate([s[0] for s in samples]), dtype=wp.int32, device="cpu")
    known.value = wp.array(np.concatenate([s[1] for s in samples]), dtype=pixel, device="cpu")
    known.cursor = wp.zeros(len(samples), dtype=wp.int32, device="cpu")
    count = ENVS * HEIGHT * WIDTH
    places = np.zeros(count + 1, np.int32)
    given += [known, wp.array(places, copy=False, device="cpu")]
    for writes in (0, 1):
        room = int(places.sum()) if writes == 0 else int(places[-1])
        out = [wp.zeros(max(room, 1), dtype=t, device="cpu") for t in (wp.int32, pixel)]
        wp.launch(make_merge(channels), count, [0, division, writes, *given, *out], device="cpu")
        if writes == 0:
            places[:] = np.cumsum(places)
    return places, out[0].numpy(), out[1].numpy()


def line(stamps, ends, when, light, channel):
    """Times and light, in one channel, of the ends of a sub-pixel's lines."""
    times = np.concatenate([stamps, when])
    order = np.argsort(times)
    return times[order], np.concatenate([ends, light]).reshape(len(times), -1)[order, channel].astype(np.float64)


def mean(lines, times):
    """The mean of sub-pixels whose ln I is on lines; one without light has none all along."""
    lit = [np.exp(np.interp(times, t, np.log(light))) for t, light in lines if light.all()]
    return np.sum(lit, axis=0) / FINENESS**2 + np.zeros(len(times))


@pytest.mark.parametrize("channels", [1, 3])
def test_means_are_those_of_the_sub_pixels_lines(channels):
    """Against float64: the lines between the samples of a mean are within twice the tolerance of it, once
    for lines that do not add up to a line and once for samples left out, and its samples are right."""
    image, frames, first, samples = lists(np.random.default_rng(channels), channels)
    held = np.array([0, 1, 0], np.int32)
    places, instants, means = merged(image, frames, first, samples, held, channels)
    t = np.arange(0, LENGTH + 1, 20)
    stamps = np.array([0, LENGTH // 2, LENGTH])
    rows, columns = HEIGHT * FINENESS, WIDTH * FINENESS
    for q in range(ENVS * HEIGHT * WIDTH):
        e, y, x = np.unravel_index(q, (ENVS, HEIGHT, WIDTH))
        mine = slice(places[q], places[q + 1])
        if held[e]:
            assert places[q] == places[q + 1]
            continue
        own = instants[mine]
        assert (np.diff(own) > 0).all() and not np.isin(own, stamps).any()
        for channel in range(channels):
            lines = []
            for j, i in np.ndindex(FINENESS, FINENESS):
                sub_y, sub_x = y * FINENESS + j, x * FINENESS + i
                when, light = samples[(e * rows + sub_y) * columns + sub_x]
                ends = [image[e, sub_y + MARGIN, sub_x + MARGIN], *frames[e * COARSE : (e + 1) * COARSE, sub_y, sub_x]]
                lines.append(line(stamps, np.array(ends), when, light, channel))
            at_t, at_own, at_frames = (mean(lines, times) for times in (t, own, stamps))
            got = means[mine].reshape(len(own), channels)[:, channel]
            np.testing.assert_allclose(got, at_own, rtol=2e-5)
            knots, order = np.concatenate([stamps, own]), np.argsort(np.concatenate([stamps, own]))
            lit = at_t > 0
            made = np.interp(t, knots[order], np.log(np.maximum(np.concatenate([at_frames, got])[order], 1e-30)))
            # Between the two samples of a jump there may be no further ones.
            steps = np.concatenate([times for times, _ in lines])
            apart = np.abs(t[:, None] - steps[None]).min(1) > 20
            assert np.abs(made - np.log(np.maximum(at_t, 1e-30)))[lit & apart].max(initial=0.0) < 2.02 * TOLERANCE
    assert places[-1] > 100


def dense(world, camera):
    """Events of supersampled rendering at 8 kHz."""
    renderer, sensors = SupersampledRenderer(world.scene, camera, 2), Sensors(camera.height, camera.width, ["linear"])
    for k in range(keyframe_count(world.end_ns, 8000.0)):
        stamp = keyframe_stamp(k, 8000.0)
        image = renderer.render(world.poses(stamp), None, {LIGHT}, {}, stamp)[LIGHT]
        sensors.process(image.copy()[:, None], np.array([stamp]))
    return sensors.streams()["linear"]


def events(world, camera, upsampling, tolerance):
    """Events of `rigid`, and how many samples there were between its frames."""
    renderer = SupersampledRenderer(world.scene, camera, 2, apart=True)
    interpolator = Interpolator("rigid", upsampling, scene=world.scene, camera=camera, time_tolerance=tolerance)
    sensors, before, samples = Sensors(camera.height, camera.width, ["linear"]), 0, 0
    for k in range(keyframe_count(world.end_ns, RATE)):
        stamp = keyframe_stamp(k, RATE)
        image = renderer.render(world.poses(stamp), None, {LIGHT}, {}, stamp)[LIGHT].copy()
        states = States(*world.states(before, stamp))
        t, frames = interpolator.push(stamp, np.zeros(1, np.int32), image, None, None, states=states)
        assert frames.shape[2:] == (camera.height, camera.width)
        sensors.process(frames, t, 1.0, interpolator.further)
        samples += 0 if interpolator.further is None else interpolator.further.offset.size
        before = stamp
    return sensors.streams()["linear"], samples


@pytest.mark.parametrize("name", ["spinning_disk", "pole"])
def test_they_have_a_third_of_the_error_of_frames(name):
    """Errors of 0.009 and 0.023, where 30x32 frames have 0.034 and 0.266."""
    if name == "pole":
        scene = extremes.pole()
    else:
        scene = load_scene(name, {"width": 48, "height": 36})
    world, camera = World(scene, round(GAPS * NS / RATE)), replace(scene.cameras[0], supersampling=2)
    truth = dense(world, camera)
    frames, none = events(world, camera, 32, 0.0)
    between, some = events(world, camera, 8, 1e-4)
    assert none == 0 < some
    assert victor_purpura(between, truth, 1.0) < victor_purpura(frames, truth, 1.0) / 3
    assert abs(len(between.t) / len(truth.t) - 1) < 0.02
