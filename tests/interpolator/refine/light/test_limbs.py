"""The light of round things at the very moment at which their outline passes a pixel."""

import dataclasses

import numpy as np
import pytest
from refine_rig import refined
from rigid_rig import FOCAL, GAP, HEIGHT, START, WIDTH, closed_form, luminance, painted, plain, pose, quad, world

from evis.scene.mesh import shapes, solids
from evis.scene.model import Light
from evis.scene.motion import Linear, Prescribed
from nodes.renderer.renderer import Renderer

K, TOLERANCE = 4, 300_000
INSTANT = GAP / K / 8
"""From one instant to the next [ns]."""
BESIDE = INSTANT / 16
"""Within which of the time of passing there is a sample on either side of it: two of the 64 parts of an instant, and
rounding."""
AWAY, RADIUS, SPEED = 2.0, 0.05, 50.0
"""Of a rod from the camera [m], and how fast it goes [m/s]: 2 px thick about its axis, 0.6 px an instant."""
SKY, SUN = 0.05, 1.0
UPRIGHT = (np.pi / 2, 0, 0)


def passing(mesh, material, lights, turn=UPRIGHT, beside=()):
    """Something that is in the middle of the image at half of the gap, and goes to the right."""
    middle = (START + GAP / 2) * 1e-9
    way = Prescribed(pose(x=-SPEED * middle, z=AWAY, turn=turn), [Linear(np.array([SPEED, 0.0, 0.0]))])
    return world([(mesh, material, way), *beside], lights=lights, sky=SKY)


def passes():
    """When the rod's outline passes each column, coming and leaving, and the outline's normal then in the plane of x
    and z: ns since START, [2, columns], and [2, columns, 2]."""
    slope = (np.arange(WIDTH) - (WIDTH - 1) / 2 - 0.3) / FOCAL
    side = np.array([1.0, -1.0])[:, None]
    # The ray is a tangent: its normal through the axis meets it at the radius.
    normal = np.stack(np.broadcast_arrays(side, -side * slope), -1) / np.sqrt(1 + slope**2)[:, None]
    axis = slope * AWAY - side * RADIUS * np.sqrt(1 + slope**2)
    return (axis / SPEED * 1e9 + GAP / 2), normal


def test_samples_beside_an_outline_have_the_light_of_the_limb():
    """The sun stands behind the camera: it shines along a limb. While a sample there had the light of the nearest
    instant, it was brighter than the limb by up to 2.4, and by 1.5 in the middle of all."""
    sun = Light("sun", "directional", np.full(3, np.pi * SUN), np.array([0.0, 0.0, 1.0]), shadows=False)
    scene = passing(shapes.cylinder(RADIUS, 4.0, finer=4), plain(0.8), [sun])
    _, (pixels, times, values) = refined(scene, K, TOLERANCE)
    when, normal = passes()
    limb = 0.8 * (SKY + SUN * np.maximum(-normal[..., 1], 0))
    inside = GAP / 40 < when
    inside &= when < GAP * 39 / 40
    off, found = [], 0
    for side, x in np.argwhere(inside):
        q = HEIGHT // 2 * WIDTH + x
        # On the rod: after it has come, before it leaves.
        later = (times[pixels == q] - when[side, x]) * (1 if side == 0 else -1)
        near = (later >= 0) & (later < BESIDE)
        found += near.any()
        off += list(np.log(values[pixels == q][near]) - np.log(limb[side, x]))
    assert found > 0.9 * inside.sum() > 30
    assert np.median(np.abs(off)) < 0.1
    # A vertex of the polygon may be off the tangent by a quarter of a side, and so may its normal.
    assert np.max(np.abs(off)) < 0.4


LIGHTS = {
    "point": Light("lamp", "point", np.full(3, 4.0), np.array([0.5, -0.7, 0.5])),
    "spot": Light(
        "spot", "spot", np.full(3, 4.0), np.array([-0.6, 0, 0.5]), direction=np.array([0.37, 0, 0.93]), cone=(0.5, 0.8)
    ),
    "area": Light(
        "panel", "area", np.full(3, 3.0), np.array([0.4, -0.5, 0.5]), shadows=False,
        half_u=np.array([0.2, 0, 0]), half_v=np.array([0, 0.1, 0.2]),
    ),
}  # fmt: skip


ROD = shapes.cylinder(RADIUS, 4.0)
STEPS = 1024
"""Of the gap, at which it is rendered: 32 in an instant."""


@pytest.mark.parametrize(
    ("mesh", "material", "light"),
    [
        (ROD, dataclasses.replace(plain(0.8), roughness=0.4), "point"),
        (ROD, painted(64), "area"),
        (shapes.capsule(RADIUS, 0.6, finer=4), plain(0.5), "point"),
        (solids.torus(0.3, 0.04), plain(0.6), "spot"),
    ],
    ids=["glossy", "painted", "capsule", "ring"],
)
def test_samples_about_outlines_are_those_of_dense_rendering(mesh, material, light):
    """They are between what is rendered from 20 us before to 20 us after. Of those between instants, which are beside
    outlines, 7 to 29 % were farther off while they had the light of an instant."""
    scene = passing(mesh, material, [LIGHTS[light]], beside=[(quad(4.0), plain(0.5), Prescribed(pose(z=3.0)))])
    _, (pixels, times, values) = refined(scene, K, TOLERANCE)
    renderer, dense = Renderer(scene, scene.cameras[0]), []
    for t in START + np.round(GAP / STEPS * np.arange(STEPS + 1)).astype(np.int64):
        states = closed_form(scene, np.array([t]))
        image = renderer.render(states.pose[:, -1], None, ("radiance",), {}, int(t))["radiance"]
        dense.append(np.log(luminance(np.asarray(image)).ravel()))
    nearest = np.round(times / GAP * STEPS).astype(int)
    about = np.array([np.array(dense)[np.clip(nearest + k, 0, STEPS), pixels] for k in range(-2, 3)])
    off = np.maximum(np.log(values) - about.max(0), about.min(0) - np.log(values))
    between = np.abs(times / INSTANT - np.round(times / INSTANT)) > 1 / 64
    assert between.sum() > 100
    assert (off[between] > 0.3).mean() < 0.04


def test_the_light_of_limbs_is_the_same_on_any_number_of_threads():
    scene = passing(shapes.capsule(RADIUS, 0.6), plain(0.5), [LIGHTS["spot"]])
    one, three = (refined(scene, K, TOLERANCE, threads=n)[1] for n in (1, 3))
    for a, b in zip(one, three):
        np.testing.assert_array_equal(a, b)
