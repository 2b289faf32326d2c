"""A light a million times as bright as the rest, in a ten thousandth of a steradian: no pixel goes astray for it."""

import numpy as np
import pytest
from light_scenes import facing
from renderer_scenes import at, camera, poses, quad, scene, sphere

from evis.scene.model import WORLD, Material, Mesh
from nodes.renderer.paths.paths import PathOptions
from nodes.renderer.renderer import Renderer

BRIGHT, ALBEDO = 1e6, 0.8
HALF = 0.01
"""Of the patch's edges [m], 2 m away: (0.02 / 2)^2 = 1e-4 sr."""


def lit(bounces, samples, thing=None):
    """A plate at z = 2 that looks at the patch at z = 0, behind the camera, under a sky of 1."""
    white = Material("white", np.full(3, ALBEDO), two_sided=True)
    glow = Material("glow", np.zeros(3), emission=np.full(3, BRIGHT), two_sided=True)
    patch = quad(HALF, HALF)
    things = [(facing(0.1, 2.0), WORLD, 0), (patch, WORLD, 1)]
    if thing is not None:
        things.append((thing, WORLD, 0))
    view = camera(24, 18, 200.0)
    scene_ = scene(things, materials=[white, glow], view=view, environment=np.ones(3))
    renderer = Renderer(scene_, view, paths=PathOptions(bounces, samples))
    image = renderer.render(poses(at(0, 0, 1.0)))["radiance"][0, ..., 0].copy()
    assert renderer.counts()[0] == 0
    return image


@pytest.mark.parametrize("bounces", [0, 2])
def test_a_tiny_glowing_patch(bounces):
    """R2: E = 1e6 * 1e-4 + pi, times albedo / pi; every pixel within a tenth of it at 16 paths, the mean within 1 %."""
    image = lit(bounces, 16)
    expected = ALBEDO / np.pi * (BRIGHT * (2 * HALF / 2) ** 2 + np.pi)
    assert image.mean() == pytest.approx(expected, rel=0.01)
    assert image.max() < 1.1 * expected and image.min() > 0.9 * expected


def test_what_the_patch_lights_shines_no_fireflies_on_the_rest():
    """With a white ball beside it that the patch lights up and that lights the plate in turn: more light than without
    it, less than if all of the patch's light came twice, and no pixel beyond its neighbours by half."""
    ball = sphere(0.3, 16)
    beside = Mesh(ball.vertices + np.array([0.8, 0, 1.5], np.float32), ball.faces)
    plain, image = lit(3, 64), lit(3, 64, beside)
    assert plain.mean() < image.mean() < 2 * plain.mean()
    assert image.max() < 1.5 * np.median(image)
