"""Luminance from the renderer is, to the bit, that of the radiance it would have given; and so are the events."""

import numpy as np
import pytest
import warp as wp
from light_scenes import facing, lamp, world
from renderer_scenes import at, camera, poses

from evis.runtime.clock import subframe_stamps
from evis.scene import load_scene
from evis.scene.model import WORLD, Light, Material, Waveform
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import States
from nodes.renderer.paths.paths import PathOptions
from nodes.renderer.renderer import Renderer
from nodes.renderer.supersampling import SupersampledRenderer

GAP = 4_000_000
SHAPES = {
    "plain": lambda scene, **more: Renderer(scene, scene.cameras[0], **more),
    "averaged": lambda scene, **more: SupersampledRenderer(scene, scene.cameras[0], 2, **more),
    "apart": lambda scene, **more: SupersampledRenderer(scene, scene.cameras[0], 2, apart=True, **more),
    "paths": lambda scene, **more: Renderer(scene, scene.cameras[0], paths=PathOptions(1, 2), **more),
}


def rec709(radiance):
    """Equation (3), each operation rounded to float32, and float16 where the radiance is."""
    r, g, b = (radiance[..., c].astype(np.float32) for c in range(3))
    value = (np.float32(0.2126) * r + np.float32(0.7152) * g) + np.float32(0.0722) * b
    return value.astype(radiance.dtype)


def room(**more):
    """A wall and a gloss plate under a lamp and a bulb; body0 is the plate."""
    bulb = Light("bulb", "point", np.array([2.0, 3.0, 1.0]), np.array([0.3, -0.5, 0.4]))
    wall = Material("wall", np.array([0.9, 0.3, 0.1]), roughness=0.4)
    lights = [bulb, lamp((0, -1.0, 0.5), (0.3, 0, 0), (0, 0.1, 0.3))]
    return world([(facing(), WORLD, 0), (facing(0.3, 0.0), 0, 1)], lights, wall, view=camera(40, 30, 40.0), **more)


@pytest.mark.parametrize("half", [False, True], ids=["float32", "float16"])
@pytest.mark.parametrize("shape", SHAPES)
def test_luminance_has_the_bits_of_the_radiance(shape, half):
    scene = room()
    colour, grey, both = (SHAPES[shape](scene, envs=2, margin=3, half=half) for _ in range(3))
    for k in range(3):
        # The last one is the second again, which is copied.
        where = np.concatenate([poses(at(0.02 * min(k, 1) + 0.1 * env, 0, 1.5), at(0, 0, 0)) for env in range(2)])
        rgb = colour.render(where, None, ("radiance",))["radiance"].copy()
        luminance = grey.render(where, None, ("luminance", "depth"))["luminance"]
        assert luminance.dtype == (np.float16 if half else np.float32) and luminance.std() > 0
        np.testing.assert_array_equal(luminance, rec709(rgb))
        at_once = both.render(where, None, ("radiance", "luminance"))
        np.testing.assert_array_equal(at_once["luminance"], luminance)
        np.testing.assert_array_equal(at_once["radiance"], rgb)


@pytest.mark.parametrize("half", [False, True], ids=["float32", "float16"])
def test_what_is_clipped_or_not_finite_is_counted_as_in_colour(half):
    scene = room()
    scene.lights[0].colour = np.array([1e6, 1.0, 1e5])
    scene.materials[1].emission = np.array([3e38, 3e38, 3e38])
    scene.materials[1].albedo = np.full(3, 1.0)
    scene.environment = np.full(3, 3e38)
    found = []
    for name in ("radiance", "luminance"):
        renderer = Renderer(scene, scene.cameras[0], half=half)
        image = renderer.render(poses(at(0, 0, 1.5), at(0, 0, 0)), None, (name,))[name].copy()
        assert np.isfinite(image).all()
        found.append((renderer.counts(), image))
    assert found[0][0] == found[1][0] and found[0][0][0] > 0 and (found[0][0][1] > 0) == half
    with np.errstate(over="ignore"):
        np.testing.assert_array_equal(found[1][1], rec709(found[0][1]))


def test_luminance_follows_a_flickering_light():
    scene = load_scene("spinning_disk", {"width": 40, "height": 30})
    scene.lights[0].waveform = Waveform("sine", 100.0, 1.0)
    poses_ = np.array([[body.trajectory.pose(np.zeros(1, np.int64))[0] for body in scene.bodies]])
    colour, grey = (Renderer(scene, scene.cameras[0]) for _ in range(2))
    seen = set()
    for t_ns in (0, 2_500_000, 7_500_000, 7_500_000):
        rgb = colour.render(poses_, None, ("radiance",), t_ns=t_ns)["radiance"]
        luminance = grey.render(poses_, None, ("luminance",), t_ns=t_ns)["luminance"]
        np.testing.assert_array_equal(luminance, rec709(rgb))
        seen.add(float(luminance.sum()))
    assert len(seen) == 3


def events(field_of, method, samples=1, apart=False, margin=0, half=False, device="cpu", envs=2):
    """Events of four keyframes of the disk; field_of(k): whether keyframe k holds radiance or luminance."""
    scene = load_scene("spinning_disk", {"width": 48, "height": 36})
    view = scene.cameras[0]
    how = {"envs": envs, "margin": margin, "half": half, "device": device}
    renderer = SupersampledRenderer(scene, view, samples, apart=apart, **how) if samples > 1 else None
    renderer = renderer or Renderer(scene, view, **how)
    interpolator = Interpolator(method, 4, device=device, scene=scene, camera=view)
    sensor = EventSensor(view.height, view.width, envs, device=device, seed=3)
    episodes, before, found = np.zeros(envs, np.int32), None, []
    for k in range(4):
        stamps = subframe_stamps(GAP * (k - 1), GAP * k, 4) if k else np.zeros(1, np.int64)
        # Environments are a little apart in time.
        paths = [[b.trajectory.pose(stamps + 500_000 * e) for b in scene.bodies] for e in range(envs)]
        pose = np.array(paths).swapaxes(1, 2)
        twist = np.array([[b.trajectory.twist(stamps + 500_000 * e) for b in scene.bodies] for e in range(envs)])
        now = np.ascontiguousarray(pose[:, -1])
        images = renderer.render(now, now if before is None else before, (field_of(k), "depth", "motion"))
        before = now
        image, depth, motion = (images[name].copy() for name in (field_of(k), "depth", "motion"))
        states = States(stamps, np.ascontiguousarray(pose), np.ascontiguousarray(twist.swapaxes(1, 2)))
        more = {"states": states} if method == "rigid" else {}
        scale = samples if apart else 1
        t, frames = interpolator.push(GAP * k, episodes, image, depth, motion, margin * scale, **more)
        found.append(sensor.process(frames, t, episodes))
    return [np.concatenate([getattr(part, name) for part in found]) for name in ("t", "x", "y", "p")]


CHAINS = {
    "rigid": {"method": "rigid"},
    "rigid, samples apart, margin": {"method": "rigid", "samples": 2, "apart": True, "margin": 4},
    "rigid, float16": {"method": "rigid", "half": True},
    "splat, margin": {"method": "splat", "margin": 4},
    "splat, averaged samples, float16": {"method": "splat", "samples": 2, "half": True},
    "none": {"method": "none"},
}


def check_chain(how):
    expected = events(lambda k: "radiance", **how)
    assert len(expected[0]) > 1000
    # The last one is a viewer that comes and goes.
    for field_of in (lambda k: "luminance", lambda k: ("luminance", "radiance")[k % 2]):
        for got, right in zip(events(field_of, **how), expected):
            np.testing.assert_array_equal(got, right)


@pytest.mark.parametrize("how", CHAINS.values(), ids=CHAINS)
def test_events_are_the_same_with_and_without_colour(how):
    check_chain(how)


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="there is no CUDA device here")
@pytest.mark.parametrize("how", CHAINS.values(), ids=CHAINS)
def test_events_are_the_same_on_a_gpu(how):
    check_chain({**how, "device": "cuda"})


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="there is no CUDA device here")
@pytest.mark.parametrize("half", [False, True], ids=["float32", "float16"])
@pytest.mark.parametrize("shape", SHAPES)
def test_luminance_has_the_bits_of_the_radiance_on_a_gpu(shape, half):
    scene = room()
    colour, grey = (SHAPES[shape](scene, envs=2, half=half, device="cuda") for _ in range(2))
    for k in range(4):
        where = np.concatenate([poses(at(0.02 * k + 0.1 * env, 0, 1.5), at(0, 0, 0)) for env in range(2)])
        rgb = colour.render(where, None, ("radiance",))["radiance"]
        np.testing.assert_array_equal(grey.render(where, None, ("luminance",))["luminance"], rec709(rgb))
