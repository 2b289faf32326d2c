"""Spot lights, flicker and area lights against closed form and float64 sums."""

import numpy as np
import pytest
from light_scenes import ALBEDO, EYE, NOWHERE, facing, flickering, lamp, render, small, world
from renderer_scenes import at, camera, poses, quad, rays, scene, sphere

from evis.scene.model import WORLD, Light, Material, Waveform
from nodes.renderer.lights.lights import waveform_strength
from nodes.renderer.renderer import Renderer

WHITE = np.array([1.0, 0.5, 0.25])


def test_waveforms_in_closed_form():
    sine = Waveform("sine", 100.0, 0.4, 0.125)
    times = np.arange(0, 20_000_000, 137_000)
    expected = 1 + 0.4 * np.sin(2 * np.pi * (100.0 * times * 1e-9 + 0.125))
    np.testing.assert_allclose([waveform_strength(sine, int(t)) for t in times], expected, atol=1e-12)
    pwm = Waveform("square", 1000.0, 1.0, 0.0, 0.25)
    assert [waveform_strength(pwm, t) for t in (0, 249_999, 250_000, 999_999, 1_000_000)] == [4.0, 4.0, 0.0, 0.0, 4.0]
    assert waveform_strength(Waveform("square", 50.0, 0.5, 0.0, 0.5), 0) == 1.5
    assert waveform_strength(None, 12345) == 1.0
    # A quarter of a 100 Hz period after 30 days: float seconds would be off by 1e-7 periods.
    assert waveform_strength(Waveform("sine", 100.0), 30 * 86400 * 10**9 + 2_500_000) == 2.0


def room():
    """Still wall and ball, a moving plate; sun, flickering bulb and flickering lamp, all with shadows."""
    sun = Light("sun", "directional", np.array([3.0, 2, 1]), np.array([0.3, 0.4, 1.0]))
    bulb = Light("bulb", "point", np.array([1.0, 2, 3]), np.array([-0.5, 0.2, 0.4]))
    area = lamp((0.3, -0.2, 0.5), (0.2, 0, 0), (0, 0.2, 0))
    meshes = [(facing(), WORLD, 0), (sphere(0.2, 12), WORLD, 1), (quad(0.15, 0.1), 0, 0)]
    scene_ = world(meshes, [sun, flickering(bulb), flickering(area, 120.0, 0.5)], view=camera(60, 45, 40.0))
    scene_.materials[0].two_sided = True
    scene_.instances[1].pose = at(-0.2, 0.2, 1.5)
    return scene_


def test_flicker_scales_only_its_own_light_and_nothing_remembered_is_stale():
    scene_ = room()
    kept = Renderer(scene_, scene_.cameras[0])
    times = [0, 1_000_000, 1_000_000, 2_500_000, 7_500_000]
    places = [at(0.05 * k, 0.1, 1.0, (2.8, 0.2, 0)) for k in (0, 1, 1, 1, 2)]
    strength = np.array([[waveform_strength(l.waveform, t) for l in scene_.lights] for t in times])
    parts = []
    for shown in range(3):
        part = room()
        for k in range(3):
            part.lights[k].waveform = None
            part.lights[k].colour = part.lights[k].colour * (k == shown)
        parts.append([render(part, place) for place in places])
    for k, (t, place) in enumerate(zip(times, places)):
        image = kept.render(poses(place, EYE), t_ns=t)["radiance"][0].copy()
        anew = Renderer(scene_, scene_.cameras[0]).render(poses(place, EYE), t_ns=t)["radiance"][0]
        np.testing.assert_array_equal(image, anew)
        expected = sum(strength[k, n] * parts[n][k] for n in range(3))
        np.testing.assert_allclose(image, expected, rtol=2e-6, atol=1e-7)
    assert strength[4, 1] == pytest.approx(0, abs=1e-12)


def test_spot_light_in_closed_form():
    axis, cone = np.array([-0.2, 0.1, 1.0]), (0.2, 0.45)
    spot = Light("spot", "spot", np.array([5.0, 4.0, 3.0]), np.array([0.3, -0.1, 0.5]), direction=axis, cone=cone)
    scene_ = world([(facing(), WORLD, 0)], [spot])
    image = render(scene_)
    to_light = spot.vector - 2.0 * rays(scene_.cameras[0])
    distance = np.linalg.norm(to_light, axis=-1)
    cosine = -(to_light @ axis) / distance / np.linalg.norm(axis)
    t = np.clip((cosine - np.cos(cone[1])) / (np.cos(cone[0]) - np.cos(cone[1])), 0, 1)
    falloff = t * t * (3 - 2 * t)
    expected = ALBEDO / np.pi * spot.colour * (falloff * 1.5 / distance**3)[..., None]
    assert (falloff == 0).any() and (falloff == 1).any()
    np.testing.assert_allclose(image, expected, rtol=2e-5, atol=1e-6)


def test_spot_light_of_a_hundredth_of_a_degree():
    axis, half = np.array([0.0, 0.0, 1.0]), 1e-4
    spot = Light("spot", "spot", np.ones(3), np.array([0.0, 0.0, -998.0]), direction=axis, cone=(half, half))
    scene_ = world([(facing(), WORLD, 1)], [spot])
    radius = np.linalg.norm(2.0 * rays(scene_.cameras[0])[..., :2], axis=-1)
    image = render(scene_)
    assert (image[radius < 0.0999] > 0).all() and (image[radius > 0.1001] == 0).all()


def corner_factor(x, y):
    """Form factor of a rectangle [0, x] x [0, y] at height 1 over a parallel element below its corner, signed."""
    a, b = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    return (x / a * np.arctan(y / a) + y / b * np.arctan(x / b)) / (2 * np.pi)


def test_irradiance_of_a_square_light_parallel_to_the_surface():
    area = lamp((0.3, -0.2, 1.2), (0.5, 0, 0), (0, 0.4, 0))
    scene_ = world([(facing(), WORLD, 0)], [area])
    place = 2.0 * rays(scene_.cameras[0])
    x = [(0.3 + s * 0.5 - place[..., 0]) / 0.8 for s in (-1, 1)]
    y = [(-0.2 + s * 0.4 - place[..., 1]) / 0.8 for s in (-1, 1)]
    factor = sum((-1) ** (i + j) * corner_factor(x[i], y[j]) for i in (0, 1) for j in (0, 1))
    np.testing.assert_allclose(render(scene_), factor[..., None] * ALBEDO * area.colour, rtol=1e-5)


@pytest.mark.parametrize("size, height, tolerance", [(1e-6, 0.3, 1e-5), (1.5e-3, 0.3, 1e-4), (0.3, 0.12, 1e-3)])
def test_irradiance_of_a_tilted_light(size, height, tolerance):
    """Against midpoints of 600^2 pieces; the largest is cut by the horizon, whose kink leaves 1e-3 of the sum.

    Of a light of 1e-3 rad float32 cancels 1e-4.
    """
    centre = np.array([0.4, 0.1, 2.0 - height])
    u, v = size * np.array([0.6, 0.0, 0.8]), size * np.array([0.0, 1.0, 0.0])
    if np.cross(u, v)[0] > 0:
        v = -v
    area = lamp(centre, u, v)
    scene_ = world([(facing(), WORLD, 1)], [area], view=small())
    image, place = render(scene_), 2.0 * rays(scene_.cameras[0])
    g = (np.arange(600) + 0.5) / 300 - 1
    points = centre + g[:, None, None] * u + g[None, :, None] * v
    normal = np.cross(u, v)
    for j, i in ((2, 3), (9, 12), (12, 5), (5, 10)):
        way = points - place[j, i]
        r = np.linalg.norm(way, axis=-1)
        integrand = np.maximum(-way[..., 2], 0) * np.maximum(-(way @ normal), 0) / r**4
        expected = 4 * integrand.mean() / np.pi * area.colour
        np.testing.assert_allclose(image[j, i], expected, rtol=tolerance, atol=1e-30)


def test_an_endless_light_gives_pi_times_its_radiance():
    area = lamp((0, 0, 1.0), (1e4, 0, 0), (0, 1e4, 0))
    image = render(world([(facing(), WORLD, 0)], [area]))
    np.testing.assert_allclose(image, np.broadcast_to(ALBEDO * area.colour, image.shape), rtol=1e-5)


def test_an_area_light_shines_to_one_side():
    backwards = lamp((0, 0, 1.0), (0.3, 0, 0), (0, -0.3, 0))
    assert (render(world([(facing(), WORLD, 0)], [backwards])) == 0).all()


def shaded_plane(samples=16, place=(0.05, 0.02, 1.5), shadows=True, **more):
    area = lamp((0.0, 0.0, 1.0), (0.2, 0, 0), (0, 0.2, 0), shadows=shadows)
    scene_ = world([(facing(), WORLD, 1), (quad(0.12, 0.1), 0, 1)], [area], view=camera(60, 45, 60.0), **more)
    return scene_, render(scene_, at(*place, (np.pi, 0, 0)), light_samples=samples)


def test_soft_shadow_against_the_seen_part_of_the_light():
    scene_, image = shaded_plane(32**2)
    _, few = shaded_plane()
    _, free = shaded_plane(shadows=False)
    place = 2.0 * rays(scene_.cameras[0])
    behind = (np.abs(place[..., :2] * 0.75 - [0.05, 0.02]) <= [0.121, 0.101]).all(-1)
    g = ((np.arange(200) + 0.5) / 100 - 1) * 0.2
    x, y = np.meshgrid(g, g)
    light = np.stack([x, y, np.ones(x.shape)], -1)
    error, coarse = [], []
    for j, i in np.argwhere(~behind)[::7]:
        way = light - place[j, i]
        weight = 1.0 / (way**2).sum(-1) ** 2
        crossing = (place[j, i] + 0.5 * way)[..., :2] - [0.05, 0.02]
        hidden = (np.abs(crossing) < [0.12, 0.1]).all(-1)
        fraction = (weight * ~hidden).sum() / weight.sum()
        error.append(image[j, i, 0] / free[j, i, 0] - fraction)
        coarse.append((few[j, i, 0] / free[j, i, 0] - fraction, fraction))
    assert np.abs(error).max() < 0.03 and np.abs(np.mean(error)) < 2e-3
    coarse = np.array(coarse)
    partly = (coarse[:, 1] > 0.01) & (coarse[:, 1] < 0.99)
    assert partly.sum() > 40
    # 16 strata, some 5 of them cut by the edge: 0.07; the mean of n such differences.
    assert coarse[partly, 0].std() < 0.1 and abs(coarse[partly, 0].mean()) < 4 * 0.07 / partly.sum() ** 0.5
    assert np.abs(coarse[coarse[:, 1] == 1, 0]).max() == 0


def test_a_still_surface_has_no_noise_and_a_moving_one_takes_its_own_along():
    """Neither camera counts as still, so that nothing is remembered."""
    scene_, image = shaded_plane(still_camera=False)
    renderer = Renderer(scene_, scene_.cameras[0])
    for t_ns in (3600, 4900):
        again = renderer.render(poses(at(0.05, 0.02, 1.5, (np.pi, 0, 0)), EYE), t_ns=t_ns)["radiance"][0]
        np.testing.assert_array_equal(again, image)
    log = np.log(image[(image > 0).all(-1)])
    assert log.std() > 0.1
    # 6 pixels to the right, all of it: 0.2 m at the plane, the same at the light.
    scene_.instances[0].pose = at(0.2, 0, 0)
    scene_.lights[0].vector = scene_.lights[0].vector + np.array([0.2, 0, 0])
    moved = render(scene_, at(0.25, 0.02, 1.5, (np.pi, 0, 0)))
    plane = (Renderer(scene_, scene_.cameras[0]).render(poses(NOWHERE, EYE), None, ("ids",))["ids"][0] == 1).all()
    assert plane
    before, after = image[:, :-6], moved[:, 6:]
    # Where the plate itself is seen it has not moved by whole pixels.
    wall = (np.abs(2.0 * rays(scene_.cameras[0])[..., :2] * 0.75 - [0.05, 0.02]).max(-1) > 0.16)[:, :-6]
    apart = np.abs(after - before).max(-1) > 1e-3 * before.max()
    assert (image[:, :-6][wall].std() > 0.02) and apart[wall].mean() < 0.01


def test_remembered_soft_shadows_change_no_bit():
    scene_ = room()
    for light in scene_.lights:
        light.waveform = None
    kept, threaded = (Renderer(scene_, scene_.cameras[0], threads=n) for n in (1, 2))
    for k in range(5):
        step = poses(at(0.1 * np.sin(k), 0.1 * np.cos(k), 1.0 + 0.02 * k, (2.8, 0.2, k)), EYE)
        new = Renderer(scene_, scene_.cameras[0]).render(step)["radiance"]
        np.testing.assert_array_equal(kept.render(step)["radiance"], new)
        np.testing.assert_array_equal(threaded.render(step)["radiance"], new)


def test_a_kernel_with_area_lights_alone_gives_the_same():
    area = lamp((0.0, 0.0, 1.0), (0.2, 0, 0), (0, 0.2, 0))
    full = render(world([(facing(), WORLD, 0), (sphere(0.1, 8), WORLD, 1)], [area]))
    lean = scene(
        [(facing(), WORLD, 0), (sphere(0.1, 8), WORLD, 1)],
        materials=[Material("diffuse", ALBEDO), Material("white", np.ones(3))],
        lights=[area],
    )
    image = Renderer(lean, lean.cameras[0]).render(poses(EYE))["radiance"][0]
    np.testing.assert_array_equal(image, full)


def test_a_light_a_billion_times_weaker_and_a_dark_surface_beside_a_glowing_one():
    weak = lamp((0.0, 0.0, 1.0), (0.2, 0, 0), (0, 0.2, 0), radiance=1e-4)
    strong = lamp((0.0, 0.0, 1.0), (0.2, 0, 0), (0, 0.2, 0), radiance=1e5)
    plane = [(facing(), WORLD, 0)]
    np.testing.assert_allclose(render(world(plane, [strong])), 1e9 * render(world(plane, [weak])), rtol=1e-5)
    glow = Material("glow", ALBEDO, emission=np.full(3, 1e6), two_sided=True)
    scene_ = world([(facing(), WORLD, 1), (quad(0.2, 0.2), 0, 0)], [weak], glow)
    image = render(scene_, at(0, 0, 0.5))
    alone = render(world([(facing(), WORLD, 1)], [weak]))
    bright = image[..., 0] >= 1e6
    assert bright.any() and not bright.all() and (image[~bright] == alone[~bright]).all()
    assert alone[..., 0].max() < 1e-4


def test_unusable_lights_are_refused():
    ones, x, y = np.ones(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    good = {"half_u": x, "half_v": y}
    for light, text in (
        (Light("l", "area", ones, ones, half_u=x), "light 'l' has half_v nan"),
        (Light("l", "area", ones, ones, half_u=x, half_v=x + y), "must be perpendicular"),
        (Light("l", "spot", ones, ones, direction=0 * x, cone=(0.1, 0.2)), "light 'l' has direction"),
        (Light("l", "spot", ones, ones, direction=x, cone=(0.3, 0.2)), "light 'l' has cone"),
        (Light("l", "area", ones, ones, **good, waveform=Waveform("saw", 1.0)), "waveform of kind 'saw'"),
        (Light("l", "area", ones, ones, **good, waveform=Waveform("sine", 1.0, 2.0)), "depth 0 ... 1"),
        (Light("l", "area", ones, ones, **good, waveform=Waveform("square", 1.0, duty=0.0)), "has duty 0"),
    ):
        with pytest.raises(ValueError, match=text):
            render(world([(facing(), WORLD, 0)], [light]))
    with pytest.raises(ValueError, match="light_samples is 5; it must be a square number"):
        render(world([(facing(), WORLD, 0)], []), light_samples=5)
    with pytest.raises(ValueError, match="material 'm' has roughness 1"):
        render(world([(facing(), WORLD, 0)], [], Material("m", ones, roughness=1.5)))
