"""Small scenes against Mitsuba 3; reference/make_reference.py says how its values were made."""

import numpy as np
import pytest
from light_scenes import render, world
from reference_scenes import REFERENCE, cube, light, rectangle, sky, view
from renderer_scenes import at, sphere

from evis.geometry import se3
from evis.scene.model import WORLD, Light, Material

VALUES = np.load(REFERENCE / "reference.npz")
METAL = Material("metal", np.ones(3), roughness=0.2**0.5, metallic=1.0, two_sided=True)


def compare(name, image, tolerance, part=1.0, where=True):
    """`part` of the pixels agree within the tolerance and four standard errors; so does the mean, within a quarter."""
    expected, error = VALUES[name], VALUES[f"{name}_error"]
    seen = np.broadcast_to(where, expected.shape[:2]) & (expected.max(-1) > 1e-3)
    assert seen.sum() > 60
    difference = np.abs(image - expected)[seen]
    good = difference <= tolerance * expected[seen] + 4 * error[seen]
    assert good.mean() >= part, np.sort((difference / expected[seen]).ravel())[-20:]
    assert image[seen].mean() == pytest.approx(expected[seen].mean(), rel=tolerance / 4)


def test_box_with_an_area_light_and_soft_shadows():
    walls = [
        ((0, 1, 2.5), (1.2, 0, 0), (0, 0, 1.5), 0),
        ((0, -1, 2.5), (1.2, 0, 0), (0, 0, 1.5), 0),
        ((0, 0, 4), (1.2, 0, 0), (0, 1, 0), 0),
        ((-1.2, 0, 2.5), (0, 1, 0), (0, 0, 1.5), 1),
        ((1.2, 0, 2.5), (0, 1, 0), (0, 0, 1.5), 2),
    ]
    colours = [(0.7, 0.7, 0.7), (0.6, 0.1, 0.1), (0.1, 0.5, 0.15), (0.8, 0.6, 0.3)]
    lamp_ = light((0, -0.98, 2.6), (0.4, 0, 0), (0, 0, -0.3), [12.0, 10.0, 7.0])
    meshes = [(rectangle(*w[:3]), WORLD, w[3]) for w in walls] + [(cube(0.3), WORLD, 3)]
    scene_ = world(meshes, [lamp_], view=view())
    scene_.materials[2:2] = [Material("", np.zeros(3))] * 2
    scene_.instances[-1].material = 4
    for material, colour in zip(scene_.materials, colours):
        material.albedo, material.two_sided = np.array(colour), True
    scene_.materials[2:4] = [Material(str(k), np.array(colours[k]), two_sided=True) for k in (2, 3)]
    scene_.instances[5].pose = se3.make_pose(np.array([0.35, 0.7, 2.9]), se3.exp(np.radians([0.0, 30.0, 0.0])))
    # The lamp itself is not seen here; in the reference it is.
    expected = VALUES["box"]
    compare("box", render(scene_, light_samples=576), 0.02, 0.99, expected.max(-1) < 6.9)


def gloss(lights):
    plane = rectangle((0, 1, 4), (4, 0, 0), (0, 0, 3.5))
    return render(world([(plane, WORLD, 0)], lights, METAL, view=view()), light_samples=576)


def test_glossy_plane_under_an_area_light():
    """Mitsuba's masking is the product of both directions' (ours correlates them): 1 % at a cosine of 0.2 and 0.3."""
    area = light((0.5, -1, 6), (0.8, 0, 0), (0, -0.36, -0.48), [5.0, 3.0, 2.0])
    compare("gloss_area", gloss([area]), 0.03, 0.99, np.arange(16)[:, None] > 8)


def test_glossy_plane_under_a_point_light():
    bulb = Light("bulb", "point", np.array([5.0, 4.0, 3.0]), np.array([0.5, -1.0, 5.0]))
    compare("gloss_point", gloss([bulb]), 0.01, 1.0, np.arange(16)[:, None] > 8)


def under_the_sky(material=None):
    meshes = [] if material is None else [(sphere(1.0, 90), WORLD, 0)]
    scene_ = world(meshes, [], material, view=view())
    scene_.environment_map = sky()
    if meshes:
        scene_.instances[0].pose = at(0, 0, 3.0)
    return render(scene_)


def test_the_sky_itself():
    compare("sky_seen", under_the_sky(), 2e-3)


def test_diffuse_ball_under_a_sky():
    compare("sky_diffuse", under_the_sky(Material("diffuse", np.array([0.7, 0.5, 0.3]))), 0.01, 0.97)


def test_glossy_ball_under_a_sky():
    """Where the lobe is seen at the ball's rim the samples are few and wide."""
    compare("sky_gloss", under_the_sky(METAL), 0.05, 0.97)
