"""Highlights that are gone again within less than the tolerance of time: where mirrors turn past a lamp."""

import dataclasses

import numpy as np
import pytest
from refine_rig import refined
from rigid_rig import FOCAL, GAP, HEIGHT, START, WIDTH, closed_form, keyframe, plain, pose, quad, world

from evis.scene.mesh import shapes, solids
from evis.scene.model import Light
from evis.scene.motion import Linear, Prescribed, Spin
from nodes.interpolator.refine.instants import instants_of
from nodes.interpolator.refine.light.curvature import curvature_of
from nodes.interpolator.refine.light.highlights import HALF, tolerance_for
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.renderer.renderer import Renderer

K, TOLERANCE = 4, 300_000
AWAY, LAMP = 2.0, np.array([0.7, -0.4, 0.0])
"""Distance of the mirror's axis from the camera, and where the lamp is [m]."""
ROUGH, RATE = 0.1, 40.0
"""Roughness of the mirror, alpha is its square, and how fast it turns [rad/s]."""


def mirror(rate=RATE, roughness=ROUGH, lights=1):
    """A square of rough metal that turns about an upright axis, facing the camera at the middle of the gap; with a rate
    of 0 it shifts instead."""
    metal = dataclasses.replace(plain(0.8), metallic=1.0, roughness=roughness)
    middle = (START + GAP / 2) * 1e-9
    motion = Spin(np.array([0.0, 1.0, 0.0]), rate) if rate else Linear(np.array([0.5, 0.0, 0.0]))
    facing = Prescribed(pose(z=AWAY, turn=(0, -rate * middle, 0)), [motion])
    lamp = Light("lamp", "point", np.full(3, 40.0), LAMP, shadows=False)
    return world([(quad(1.2), metal, facing)], lights=[lamp] * lights)


def peaks():
    """When the normal is nearest to the half vector of lamp and view, ns since START, [h, w], found on a dense grid.

    The mirror is the plane through its axis; a pixel's ray meets it elsewhere at each time.
    """
    t = np.linspace(0, GAP, 801)  # every 12.5 us, of the 160 us that are asked for
    angle = RATE * (t - GAP / 2) * 1e-9
    normal = np.stack([-np.sin(angle), 0 * angle, -np.cos(angle)], -1)
    x, y = np.meshgrid(np.arange(WIDTH) - (WIDTH - 1) / 2 - 0.3, np.arange(HEIGHT) - (HEIGHT - 1) / 2 + 0.2)
    ray = np.stack([x / FOCAL, y / FOCAL, np.ones_like(x)], -1)[:, :, None]
    depth = AWAY * normal[:, 2] / (ray * normal).sum(-1)
    point = depth[..., None] * ray
    light = LAMP - point
    light /= np.linalg.norm(light, axis=-1, keepdims=True)
    view = -ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    half = light + view
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    off = np.arccos(np.clip((half * normal).sum(-1), -1, 1))
    return t[off.argmin(-1)], off.min(-1)


def test_a_sample_is_within_half_of_the_width_of_every_highlight():
    """Of 107 pixels 96 % have one. While instants were as close as 0.3 ms alone asks for it were 83 %, and 86 %
    while an interval with a peak in its middle, at whose ends light is the same, was not halved."""
    _, (pixels, times, _) = refined(mirror(), K, TOLERANCE)
    when, off = peaks()
    shown = (off < 2 * ROUGH**2) & (when > GAP / 20) & (when < GAP * 19 / 20)
    assert shown.sum() > 80
    wide = HALF * ROUGH**2 / RATE * 1e9
    near = [np.abs(times[pixels == q] - when.ravel()[q]).min(initial=GAP) < wide for q in np.flatnonzero(shown)]
    assert np.mean(near) > 0.93


@pytest.mark.parametrize(
    ("scene", "closer"),
    [(mirror(roughness=0.1), True), (mirror(roughness=0.4), False), (mirror(lights=0), False), (mirror(rate=0), False)],
)
def test_only_sharp_highlights_of_lamps_on_what_turns_bring_instants_closer(scene, closer):
    wanted = tolerance_for(scene, TOLERANCE)
    assert (wanted < TOLERANCE) == closer
    assert tolerance_for(scene, 50_000) == 50_000


def test_gaps_of_thirty_keyframes_a_second_have_no_more_instants_than_a_tenth_of_a_millisecond_has():
    sharp, wanted = mirror(roughness=0.01), 100_000
    gap = 33_333_333
    depth = [instants_of(gap, 8, t, 1000, 4, True).depth for t in (wanted, tolerance_for(sharp, wanted))]
    assert depth[0] == depth[1]


def counted(scene):
    """Tells whether a gap of 10 ms counts as one in which something passes unseen, with 4 frames and 0.3 ms."""
    view = scene.cameras[0]
    renderer = Renderer(scene, view)
    first, second = (closed_form(scene, np.array([t, t + GAP])) for t in (START - GAP, START))
    a = keyframe(renderer, first, first.pose[:, 0], START)
    b = keyframe(renderer, second, first.pose[:, -1], START + GAP)
    method = Refined(Rigid(scene, view, 1, K, options=RigidOptions(single=True)), TOLERANCE)
    return bool(method.between(a, b, [False], np.empty((1, K, view.height, view.width), np.float32)).unseen)


@pytest.mark.parametrize(("rate", "unseen"), [(RATE, False), (8 * RATE, True)])
def test_what_turns_too_fast_is_counted(rate, unseen):
    """An instant is 0.08 ms from the next one, and a highlight within HALF of alpha for 0.32 and 0.04 ms."""
    assert counted(mirror(rate)) == unseen


UPRIGHT = pose(turn=(np.pi / 2, 0, 0))[3:]
RADIUS = 0.05
INSTANT_S = GAP * 1e-9 / K / 8
"""From one instant to the next: of the halves, quarters, eighths .. of an interval the first within two TOLERANCES."""
PACE = 2 * HALF * ROUGH**2 * RADIUS / INSTANT_S
"""Speed [m/s] over a rod at which a highlight has half of its radiance for that long; a metre turns by 1 / RADIUS."""


def rod(shape, pace=0.0, turning=0.0, roughness=ROUGH, lights=1):
    """Something of metal in the middle of the image at half of the gap, that shifts; turning: rate of the camera."""
    metal = dataclasses.replace(plain(0.8), metallic=1.0, roughness=roughness)
    middle = (START + GAP / 2) * 1e-9
    place = np.concatenate([[-pace * middle, 0.0, AWAY], UPRIGHT])
    flight = Prescribed(place, [Linear(np.array([pace, 0.0, 0.0]))] if pace else [])
    eye = Prescribed(pose(turn=(0, -turning * middle, 0)), [Spin(np.array([0.0, 1.0, 0.0]), turning)])
    given = [Light("lamp", "point", np.full(3, 40.0), LAMP, shadows=False)] * lights
    # Something beside it moves in any case.
    beside = quad(0.01), plain(0.2), Prescribed(pose(x=5.0, z=AWAY), [Linear(np.array([0.01, 0.0, 0.0]))])
    return world([(shape, metal, flight), beside], camera_motion=eye if turning else None, lights=given)


@pytest.mark.parametrize("seen_by", ["pace", "turning"])
@pytest.mark.parametrize(("faster", "unseen"), [(0.7, False), (1.5, True)])
def test_what_is_round_and_goes_by_too_fast_is_counted(seen_by, faster, unseen):
    """Before a camera that turns a rod goes by as fast as it is far away."""
    how = {seen_by: faster * PACE / (AWAY if seen_by == "turning" else 1.0)}
    assert counted(rod(shapes.cylinder(RADIUS, 1.0), **how)) == unseen


@pytest.mark.parametrize(
    ("shape", "given"),
    [
        (shapes.cylinder(RADIUS, 1.0), {"roughness": 0.4}),
        (shapes.cylinder(RADIUS, 1.0), {"lights": 0}),
        (shapes.box(np.array([0.1, 0.1, 1.0])), {}),
        (shapes.sphere(RADIUS), {}),  # Its highlight is 0.1 px wide, and hardly any pixel's.
    ],
)
def test_what_has_no_sharp_highlight_that_pixels_go_over_is_not(shape, given):
    assert not counted(rod(shape, 3 * PACE, **given))


@pytest.mark.parametrize(
    ("shape", "greater", "lesser"),
    [
        (shapes.sphere(0.2), 5.0, 5.0),
        (shapes.cylinder(0.1, 1.0), 10.0, 0.0),
        (shapes.capsule(0.1, 2.0), 10.0, 0.0),
        (solids.torus(0.5, 0.05), 20.0, None),
        (shapes.box(np.array([0.3, 0.2, 0.1])), 0.0, 0.0),
    ],
)
def test_curvatures_are_those_of_the_shape(shape, greater, lesser):
    """Sphere, cylinder and ring have 1 / radius, of the ring its tube's; the triangles are 1.5 % smaller."""
    scene = world([(shape, plain(0.5), "world")])
    found = curvature_of(Renderer(scene, scene.cameras[0]).visibility.geometry, 0)
    assert found[0] == pytest.approx(greater, rel=0.03)
    assert lesser is None or found[1] == pytest.approx(lesser, rel=0.03, abs=1e-3)
