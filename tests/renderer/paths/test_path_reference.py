"""Light over several surfaces, hidden sky light and glowing surfaces against Mitsuba 3.

reference/make_path_reference.py says how the values were made; their standard errors are stored with them.
"""

import numpy as np
import pytest
from light_scenes import render, world
from reference_scenes import REFERENCE, cube, light, rectangle, sky, view
from renderer_scenes import at, sphere

from evis.geometry import se3
from evis.scene.model import WORLD, Material
from nodes.renderer.paths.paths import PathOptions

VALUES = np.load(REFERENCE / "path_reference.npz")
WALLS = {
    "floor": ((0, 1, 2.5), (1.2, 0, 0), (0, 0, 1.5), (0.7, 0.7, 0.7)),
    "ceiling": ((0, -1, 2.5), (1.2, 0, 0), (0, 0, 1.5), (0.7, 0.7, 0.7)),
    "back": ((0, 0, 4), (1.2, 0, 0), (0, 1, 0), (0.7, 0.7, 0.7)),
    "left": ((-1.2, 0, 2.5), (0, 1, 0), (0, 0, 1.5), (0.6, 0.1, 0.1)),
    "right": ((1.2, 0, 2.5), (0, 1, 0), (0, 0, 1.5), (0.1, 0.5, 0.15)),
}
BLOCK = se3.make_pose(np.array([0.35, 0.7, 2.9]), se3.exp(np.radians([0.0, 30.0, 0.0])))
PLATE = rectangle((0, -0.98, 2.6), (0.4, 0, 0), (0, 0, -0.3))
"""What is seen of the lamp; being its picture it gives no light of its own."""
LAMP = light((0, -0.98, 2.6), (0.4, 0, 0), (0, 0, -0.3), [12.0, 10.0, 7.0])


def box(walls, mesh, place, material, lights):
    """Walls of their colours and one thing among them."""
    lamps = [(PLATE, WORLD, 2)] * len(lights)
    scene_ = world([(rectangle(*WALLS[name][:3]), WORLD, 0) for name in walls] + [(mesh, WORLD, 0), *lamps], lights)
    scene_.cameras = [view()]
    first = len(scene_.materials)
    scene_.materials += [Material(name, np.array(WALLS[name][3]), two_sided=True) for name in walls] + [material]
    for index in range(len(walls) + 1):
        scene_.instances[index].material = first + index
    scene_.instances[len(walls)].pose = place
    if lights:
        scene_.materials.append(Material("lamp", np.zeros(3), emission=lights[0].colour, two_sided=True))
        scene_.instances[len(walls) + 1].material = len(scene_.materials) - 1
    return scene_


def compare(name, image, tolerance, part, where=True):
    """`part` of the pixels agree within the tolerance and four standard errors; so does the mean, within a fifth."""
    expected, error = VALUES[name], VALUES[f"{name}_error"]
    seen = np.broadcast_to(where, expected.shape[:2]) & (expected.max(-1) > 1e-3)
    assert seen.sum() > 60
    difference = np.abs(image - expected)[seen]
    good = difference <= tolerance * expected[seen] + 4 * error[seen]
    assert good.mean() >= part, np.sort((difference / expected[seen]).ravel())[-20:]
    assert image[seen].mean() == pytest.approx(expected[seen].mean(), rel=tolerance / 5)


def tan():
    return Material("tan", np.array([0.8, 0.6, 0.3]), two_sided=True)


def test_box_with_a_lamp_and_three_bounces():
    image = render(box(WALLS, cube(0.3), BLOCK, tan(), [LAMP]), light_samples=256, paths=PathOptions(3, 256))
    compare("box", image, 0.03, 0.99)


def test_box_lit_by_a_glowing_block():
    glow = Material("glow", np.zeros(3), emission=np.array([6.0, 5.0, 4.0]), two_sided=True)
    compare("glow", render(box(WALLS, cube(0.3), BLOCK, glow, []), paths=PathOptions(2, 256)), 0.03, 0.99)


@pytest.mark.parametrize("name, bounces", [("sky", 0), ("sky_bounced", 2)])
def test_open_corner_under_a_sky(name, bounces):
    scene_ = box(("floor", "left"), cube(0.3), BLOCK, tan(), [])
    scene_.environment_map = sky()
    compare(name, render(scene_, paths=PathOptions(bounces, 256)), 0.03, 0.98)


def test_metal_ball_in_the_box():
    """Mitsuba's masking is the product of both directions' (ours correlates them)."""
    metal = Material("metal", np.ones(3), roughness=0.3**0.5, metallic=1.0)
    scene_ = box(WALLS, sphere(0.5, 60), at(0.3, 0.5, 2.8), metal, [LAMP])
    image = render(scene_, light_samples=256, paths=PathOptions(2, 256))
    compare("metal", image, 0.04, 0.98)
