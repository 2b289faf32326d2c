"""Light over several surfaces in closed form: furnaces, one bounce between plates, hidden skies, numbers that stay."""

import numpy as np
import pytest
from ggx_reference import reflected
from light_scenes import facing, world
from node_bus import start, state
from reference_scenes import cube
from renderer_scenes import at, camera, poses, quad, scene, sphere

from evis.scene.model import WORLD, Light, Material, Mesh
from nodes.renderer.paths.paths import PathOptions, emitter_kinds
from nodes.renderer.renderer import Renderer

SIZE = camera(24, 18, 20.0)


def image_of(scene_, where, options, **more):
    renderer = Renderer(scene_, scene_.cameras[0], paths=options, **more)
    image = renderer.render(poses(*where))["radiance"][0].copy()
    assert renderer.counts()[0] == 0
    return image


@pytest.mark.parametrize("bounces", [0, 1, 6])
@pytest.mark.parametrize("mesh", [cube(2.0), sphere(2.0, 24)], ids=["box", "sphere"])
def test_glowing_furnace(mesh, bounces):
    """Inside a closed surface that glows everywhere: L = Le (1 + rho + ... + rho^(n + 1)), Le / (1 - rho) in the end.

    With one sample more of aiming at the surface the sum is noisy; its mean over the image is not.
    """
    glow, albedo = np.array([1.0, 2.0, 0.5]), np.array([0.5, 0.8, 0.2])
    furnace = scene([(mesh, WORLD, 0)], materials=[Material("m", albedo, emission=glow, two_sided=True)], view=SIZE)
    image = image_of(furnace, [at(0.3, 0.2, 0.1)], PathOptions(bounces, 256))
    expected = glow * sum(albedo**k for k in range(bounces + 2))
    np.testing.assert_allclose(image.mean((0, 1)), expected, rtol=5e-3)
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=0.1)


def test_furnace_with_roulette_is_the_same_on_average():
    albedo = np.full(3, 0.7)
    glow = Material("m", albedo, emission=np.ones(3), two_sided=True)
    furnace = scene([(cube(2.0), WORLD, 0)], materials=[glow], view=SIZE)
    image = image_of(furnace, [at(0.3, 0.2, 0.1)], PathOptions(20, 256, roulette=True))
    assert image.mean() == pytest.approx(1 / 0.3, rel=5e-3)


@pytest.mark.parametrize("bounces", [0, 3])
def test_white_surface_under_a_white_sky_vanishes(bounces):
    """A convex white body gives back all it gets: exactly 1, without noise."""
    white = Material("white", np.ones(3))
    ball = sphere(1.0, 16)
    scene_ = scene([(Mesh(ball.vertices, ball.faces), 0, 0)], 1, [white], view=SIZE, environment=np.ones(3))
    image = image_of(scene_, [at(0, 0, 3), at(0, 0, 0)], PathOptions(bounces, 4))
    np.testing.assert_allclose(image, 1.0, rtol=1e-5)


@pytest.mark.parametrize("roughness", [0.3, 0.6])
def test_metal_under_a_white_sky(roughness):
    """The albedo of the lobe at the cosine of the view, integrated in float64."""
    metal = Material("metal", np.ones(3), roughness=roughness, metallic=1.0)
    plate = facing(20.0, 2.0)
    view = camera(24, 18, 12.0)
    scene_ = scene([(plate, WORLD, 0)], materials=[metal], view=view, environment=np.ones(3))
    image = image_of(scene_, [at(0, 0, 0)], PathOptions(0, 256))
    y, x = np.mgrid[:18, :24]
    cosine = 1 / np.sqrt(1 + ((x - view.k[0, 2]) / view.k[0, 0]) ** 2 + ((y - view.k[1, 2]) / view.k[1, 1]) ** 2)
    at_cosines = np.linspace(cosine.min(), 1, 6)
    expected = np.interp(cosine, at_cosines, reflected(1.0, roughness, at_cosines))
    np.testing.assert_allclose(image[..., 0], expected, rtol=0.015)


def test_metal_furnace():
    """A rough metal box that glows: every bounce gives back less than all, by what is lost among the microfacets."""
    glow = Material("metal", np.ones(3), emission=np.ones(3), roughness=0.5, metallic=1.0, two_sided=True)
    furnace = scene([(cube(2.0), WORLD, 0)], materials=[glow], view=SIZE)
    for bounces in (0, 2):
        image = image_of(furnace, [at(0.3, 0.2, 0.1)], PathOptions(bounces, 256))
        given = reflected(1.0, 0.5, np.linspace(0.05, 1.0, 12))
        least, most = (sum(a**k for k in range(bounces + 2)) for a in (given.min(), given.max()))
        assert 0.995 * least <= image.mean() <= 1.005 * most


def test_one_bounce_between_two_plates():
    """A sunlit wall lights a wide plate that faces it: E = pi L F with the view factor of a rectangle, in closed form.

    The plate seen lies in the shadow side of the sun; what it shows is albedo^2 sun / pi times the form factor.
    """
    half, gap = 1.0, 2.0
    lit = Mesh(quad(half, half).vertices + np.array([0, 0, gap - 2], np.float32), quad(half, half).faces)
    # The seen plate at z = 2 faces the camera (-z); the lit one lies at z = 0 beyond it and faces away from the camera.
    seen = facing(0.02, 2.0)
    sun = Light("sun", "directional", np.full(3, 3.0), np.array([0, 0, -1.0]), shadows=False)
    white = Material("white", np.full(3, 0.8), two_sided=False)
    scene_ = scene([(seen, WORLD, 0), (lit, WORLD, 0)], materials=[white], lights=[sun], view=camera(9, 9, 600.0))
    image = image_of(scene_, [at(0, 0, 1.0)], PathOptions(1, 4096))
    # From a point on the axis of a square: four times that of a corner.
    a = half / gap
    corner = 2 * a / np.sqrt(1 + a * a) * np.arctan(a / np.sqrt(1 + a * a)) / (2 * np.pi)
    expected = 0.8 * 4 * corner * 0.8 * 3.0 / np.pi
    assert image[4, 4].mean() == pytest.approx(expected, rel=0.01)


def test_sky_over_a_wall():
    """A floor before a wide black wall sees (1 + cos(t)) / 2 of the sky, t the angle of the wall's height."""
    black = Material("black", np.zeros(3), two_sided=True)
    floor = Material("floor", np.full(3, 0.5), two_sided=True)
    tall = quad(500.0, 1.0)
    up = tall.vertices @ np.array([(1, 0, 0), (0, 0, 1), (0, 1, 0)], np.float32)
    wall = Mesh(up + np.array([0, 0, 1.0], np.float32), tall.faces)
    scene_ = scene(
        [(quad(900.0, 900.0), WORLD, 0), (wall, WORLD, 1)], materials=[floor, black], view=camera(9, 9, 300.0)
    )
    scene_.environment = np.ones(3)
    for away in (1.0, 4.0):
        image = image_of(scene_, [at(0, -away, 1.5, (np.pi, 0, 0))], PathOptions(0, 1024))
        expected = 0.5 * (1 + np.cos(np.arctan(2.0 / away))) / 2
        assert image[4, 4, 0] == pytest.approx(expected, rel=0.01)


def room():
    """Plain walls with a lamp and a block: something to bounce on everywhere."""
    block = cube(0.4)
    materials = [Material("wall", np.array([0.7, 0.6, 0.5]), two_sided=True)]
    bulb = Light("bulb", "point", np.full(3, 5.0), np.array([0.5, -1.0, 0.2]))
    return scene([(cube(2.0), WORLD, 0), (block, 0, 0)], 1, materials, [bulb], camera(64, 48, 50.0), still_camera=False)


@pytest.mark.parametrize("bounces", [1, 3])
def test_few_paths_keep_the_light_of_a_lamp_in_a_hollow_sphere(bounces):
    """Every part of a hollow sphere gives every other part the same irradiance: power / area times the albedos on the
    way, wherever the lamp is."""
    albedo, radius, intensity = 0.6, 1.5, 2.0
    wall = Material("wall", np.full(3, albedo), two_sided=True)
    bulb = Light("bulb", "point", np.full(3, intensity), np.array([0.3, 0.15, 0.0]))
    hollow = scene([(sphere(radius, 24), WORLD, 0)], materials=[wall], lights=[bulb], view=SIZE)
    where = [at(0, 0, -0.5)]
    direct = Renderer(hollow, hollow.cameras[0]).render(poses(*where))["radiance"][0].astype(np.float64)
    over = image_of(hollow, where, PathOptions(bounces, 16)) - direct
    power, area = 4 * np.pi * intensity, 4 * np.pi * radius**2
    expected = albedo / np.pi * power / area * sum(albedo**n for n in range(1, bounces + 1))
    assert over.mean() == pytest.approx(expected, rel=0.04)


def test_still_camera_sees_the_same_bytes():
    scene_ = room()
    renderer = Renderer(scene_, scene_.cameras[0], paths=PathOptions(2, 4))
    where = poses(at(0.5, 0.5, 1.0), at(-1, 0, -1))
    first = renderer.render(where)["radiance"].copy()
    far = poses(at(0.6, 0.5, 1.0), at(-1, 0.1, -1))
    assert not np.array_equal(renderer.render(far)["radiance"], first)
    again = renderer.render(where)["radiance"]
    np.testing.assert_array_equal(again, first)


def test_numbers_stay_on_the_surface():
    """Two cameras that see the same points of a wall see the same noise: what a diffuse point gives is its own.

    The second stands nearer on the same axis with half the focal length of its distance, so that pixel rays meet the
    wall at the same points; the frames in which they are computed differ by float32 only.
    """
    scene_ = room()
    images = []
    for distance, focal in ((1.0, 50.0), (2.0, 100.0)):
        view = camera(40, 30, focal)
        view.k[0, 2], view.k[1, 2] = 19.5, 14.5
        scene_.cameras = [view]
        eye = at(-0.8, 0, 2.0 - distance)
        images.append(image_of(scene_, [at(1.2, 0.5, -1.0), eye], PathOptions(1, 4)))
    ratio = np.log(images[1] / images[0])
    # A ray on an edge of the block may go either way.
    assert (np.abs(ratio) < 1e-3).mean() > 0.97
    smooth = np.abs(np.diff(np.log(images[0]), axis=1))
    assert smooth.max() > 1e-3


def test_threads_halves_and_environments_agree():
    scene_ = room()
    where = poses(at(0.5, 0.5, 1.0), at(-1, 0, -1))
    options = PathOptions(1, 4)
    plain = Renderer(scene_, scene_.cameras[0], paths=options).render(where)["radiance"].copy()
    threads = Renderer(scene_, scene_.cameras[0], threads=3, paths=options).render(where)["radiance"]
    np.testing.assert_array_equal(threads, plain)
    two = Renderer(scene_, scene_.cameras[0], envs=2, paths=options)
    both = np.concatenate([where, poses(at(0.2, 0.5, 1.0), at(-1, 0, -1))])
    np.testing.assert_array_equal(two.render(both)["radiance"][0], plain[0])
    half = Renderer(scene_, scene_.cameras[0], half=True, paths=options).render(where)["radiance"]
    np.testing.assert_array_equal(half, plain.astype(np.float16))


def test_a_shade_that_shows_a_lamp_is_not_counted_twice():
    shade = Material("shade", np.zeros(3), emission=np.full(3, 9.0), two_sided=True)
    wall = Material("wall", np.full(3, 0.5), two_sided=True)
    bulb = Light("bulb", "point", np.ones(3), np.array([0, 0, 1.0]), shadows=False)
    meshes = [(facing(), WORLD, 0), (sphere(0.1, 8), WORLD, 1)]
    scene_ = scene(meshes, materials=[wall, shade], lights=[bulb], view=SIZE)
    scene_.instances[1].pose = at(0, 0, 1.0)
    lit = image_of(scene_, [at(0, 0, 0)], PathOptions(0, 4))
    renderer = Renderer(scene_, scene_.cameras[0])
    np.testing.assert_array_equal(lit, renderer.render(poses(at(0, 0, 0)))["radiance"][0])
    scene_.lights = []
    assert emitter_kinds(scene_, renderer.visibility).tolist() == [0, 1]
    assert (image_of(scene_, [at(0, 0, 0)], PathOptions(0, 64))[0, 0] > 0).all()


@pytest.mark.parametrize("bad", [{"bounces": -1}, {"bounces": 64}, {"samples": 0}])
def test_bad_options_are_named(bad):
    with pytest.raises(ValueError, match=r"bounces is|path_samples is"):
        PathOptions(**bad)


def test_without_paths_nothing_of_them_is_there():
    scene_ = world([(facing(), WORLD, 0)], [])
    assert Renderer(scene_, scene_.cameras[0]).shading.paths is None


@pytest.mark.parametrize("params", [{"bounces": 1, "path_samples": 2}, {"sky_occlusion": True, "path_samples": 2}])
def test_the_node_traces_paths_where_it_is_told_to(params):
    sent = {}
    for name, given in (("direct", {}), ("paths", params)):
        node, bus = start("keyframe", **given)
        node.update({"state": state(node.scene, 0)})
        sent[name] = bus.take()["keyframe"].radiance.copy()
    assert sent["paths"].shape == sent["direct"].shape and np.isfinite(sent["paths"]).all()
    assert not np.allclose(sent["paths"], sent["direct"], rtol=0.01)
