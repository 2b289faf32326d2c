"""K of a gap from the displacement in it, and a sensor that gets gaps of changing K."""

import numpy as np
import pytest
from rigid_rig import FOCAL, camera, closed_form, painted, pose, quad, world

from evis.runtime.clock import subframe_stamps
from evis.scene.model import Light, Waveform
from evis.scene.motion import Linear, Prescribed
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.adaptive import counts_of
from nodes.interpolator.interpolator import Interpolator
from nodes.renderer.renderer import Renderer

GAP = 10_000_000
NONE = np.zeros(1, np.int32)


@pytest.mark.parametrize("upsampling,counts", [(1, [1]), (8, [1, 2, 4, 8]), (12, [1, 2, 3, 6, 12])])
def test_gaps_have_halves_of_the_largest_count(upsampling, counts):
    assert counts_of(upsampling) == counts


def flat(steps, adaptive_px=1.0, upsampling=16):
    """K of gaps of a plain image that moves by so many px."""
    interpolator = Interpolator("splat", upsampling, adaptive_px=adaptive_px)
    counts = []
    for k, step in enumerate([0.0, *steps]):
        motion = np.zeros((1, 8, 8, 2), np.float32)
        motion[0, 3, 4] = 0.6 * step, 0.8 * step
        t, frames = interpolator.push(
            k * GAP, NONE, np.ones((1, 8, 8, 3), np.float32), np.ones((1, 8, 8), np.float32), motion
        )
        assert frames.shape[1] == len(t)
        if k:
            assert t.tolist() == subframe_stamps((k - 1) * GAP, k * GAP, len(t)).tolist()
        counts.append(len(t))
    return counts[1:]


def test_the_count_follows_the_fastest_pixel_of_both_ends():
    assert flat([0, 0.9, 0.0, 3.5, 0, 0, 100, 0]) == [1, 1, 1, 4, 4, 1, 16, 16]
    assert flat([4.0], adaptive_px=0.5) == [8] and flat([4.0], adaptive_px=4.0) == [1]
    assert flat([4.0, 0], adaptive_px=0) == [16, 16]


def rolled(interpolator, scene, gaps=3):
    """Frames of some gaps, [(stamps, frames)]."""
    view = scene.cameras[0]
    renderer = Renderer(scene, view)
    made = []
    for k in range(gaps + 1):
        t = np.linspace(max(k - 1, 0) * GAP, k * GAP, 11).astype(np.int64)
        states = closed_form(scene, np.unique(t))
        images = renderer.render(states.pose[:, -1], None, ("radiance",), {}, k * GAP)
        stamps, frames = interpolator.push(k * GAP, NONE, images["radiance"].copy(), None, None, states=states)
        made.append((stamps, frames[0].copy()))
    return made


def wall(speed, lights=()):
    """A painted wall at 1 m that goes along x at a speed [m/s]."""
    motion = Prescribed(pose(-0.1, 0, 1), [Linear(np.array([speed, 0.0, 0.0]))])
    return world([(quad(2.0), painted(), motion)], lights=lights)


def test_by_states_the_count_is_the_displacement_in_pixels():
    """v F / z per gap: 0.4 m/s x 80 px x 10 ms = 0.32 px; 4 m/s: 3.2 px."""
    assert FOCAL == 80
    for speed, count in ((0.0, 1), (0.4, 1), (4.0, 4), (40.0, 16)):
        scene = wall(speed)
        interpolator = Interpolator("rigid", 16, scene=scene, camera=scene.cameras[0], adaptive_px=1.0)
        assert [len(t) for t, _ in rolled(interpolator, scene)] == [1, count, count, count]


def test_what_flickers_keeps_all_its_frames():
    light = Light("lamp", "point", np.full(3, 4.0), np.array([0, 0, 0.0]), waveform=Waveform("sine", 100.0, 0.5))
    scene = wall(0.0, [light])
    interpolator = Interpolator("rigid", 8, scene=scene, camera=scene.cameras[0], adaptive_px=1.0)
    assert len(rolled(interpolator, scene, 1)[1][0]) == 8


def test_a_count_gives_the_very_frames_that_it_gives_when_fixed():
    scene = wall(4.0)
    view = camera()
    fixed, adaptive = (
        rolled(Interpolator("rigid", k, scene=scene, camera=view, adaptive_px=px), scene)
        for k, px in ((4, 0.0), (16, 1.0))
    )
    for (t, frames), (u, others) in zip(fixed, adaptive, strict=True):
        assert np.array_equal(t, u) and np.array_equal(frames, others)


@pytest.mark.parametrize("crossing", ["linear", "monotone"])
def test_the_sensor_does_not_see_how_frames_are_bundled(crossing):
    """Frames in bundles of 1, 4, 2, 16, 1 and one at a time are the same events."""
    rng = np.random.default_rng(5)
    frames = np.exp(rng.normal(0, 0.5, (1, 24, 6, 7))).astype(np.float32)
    t = np.cumsum(rng.integers(1000, 90_000, 24))

    def events(bundles):
        sensor = EventSensor(6, 7, threshold=0.2, crossing=crossing)
        parts, at = [], 0
        for n in bundles:
            parts.append(sensor.process(frames[:, at : at + n], t[at : at + n], NONE))
            at += n
        parts.append(sensor.flush())
        return [np.concatenate([getattr(p, name) for p in parts]) for name in "txyp"]

    single = events([1] * 24)
    assert len(single[0]) > 100
    for a, b in zip(events([1, 4, 2, 16, 1]), single, strict=True):
        assert np.array_equal(a, b)
