"""Where a texture's filter lies and how wide it is: about the pixel's centre, and without steps as it widens."""

import numpy as np
import pytest
from renderer_scenes import at, camera, poses, quad, rays, scene

from evis.scene.model import Material
from nodes.renderer.renderer import Renderer

HALF = 2.0
"""Of the textured square [m], whose uv run from 0 to 1."""


def lit(texture, view):
    """A textured square under a sky of 1: its radiance is its albedo."""
    material = Material("m", np.ones(3), texture, two_sided=True)
    return scene([(quad(HALF, HALF), 0, 0)], bodies=1, materials=[material], view=view, environment=(1.0, 1.0, 1.0))


def grey(column):
    return np.repeat(np.asarray(column)[..., None], 3, -1).astype(np.float32)


@pytest.mark.parametrize("along", ["u", "v"])
def test_a_long_footprint_lies_about_the_pixels_centre(along):
    """A ramp, whose mean over anything symmetric is its value in the middle, on a plane that is seen at a slant.

    A pixel covers several times as many texels down the slant as across. What the ramp is at the centre follows from
    where the ray meets the plane, in float64; half a texel is allowed for what perspective bends within the footprint.
    """
    texels = 1024
    ramp = np.broadcast_to(0.1 + 0.8 * (np.arange(texels) + 0.5) / texels, (texels, texels))
    view = camera(48, 36, 100.0)
    # Row 0 of a texture is v = 1, so that the ramp falls with v.
    texture = grey(ramp if along == "u" else ramp.T)
    tilt = np.radians(75)
    turn = (tilt, 0, 0) if along == "v" else (0, tilt, 0)
    distance = 1.5
    image = Renderer(lit(texture, view), view).render(poses(at(0, 0, distance, turn), at(0, 0, 0)))["radiance"][
        0, ..., 0
    ]
    d = rays(view)
    # The plane through (0, 0, distance): its in-plane axes in the camera's frame.
    if along == "v":
        normal, axis = np.array([0, -np.sin(tilt), np.cos(tilt)]), np.array([0, np.cos(tilt), np.sin(tilt)])
    else:
        normal, axis = np.array([np.sin(tilt), 0, np.cos(tilt)]), np.array([np.cos(tilt), 0, -np.sin(tilt)])
    point = d * (distance * normal[2] / (d @ normal))[..., None]
    place = (point - [0, 0, distance]) @ axis / (2 * HALF) + 0.5
    seen = (place > 0.1) & (place < 0.9) & (image > 0)
    assert seen.sum() > 500
    expected = 0.1 + 0.8 * (place if along == "u" else 1 - place)
    assert np.abs(image - expected)[seen].max() < 0.5 * 0.8 / texels


def test_the_filter_widens_without_steps():
    """A camera backs away over three octaves: what it sees at its axis, the same point of a random texture, goes over
    from each level of the pyramid to the next. In 30 parts an octave, of levels that differ by 0.1 to 0.4 in places."""
    texture = grey(np.random.default_rng(5).random((64, 64)))
    view = camera(5, 5, 20.0)
    renderer = Renderer(lit(texture, view), view)
    # 64 texels are 4 m: a pixel covers 0.8 texels per metre.
    distances = np.geomspace(2.0, 16.0, 91)
    for x, y in np.random.default_rng(6).uniform(-0.9, 0.9, (12, 2)):
        seen = [renderer.render(poses(at(x, y, z), at(0, 0, 0)))["radiance"][0, 2, 2, 0] for z in distances]
        assert np.abs(np.diff(seen)).max() < 0.02
