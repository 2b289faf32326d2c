"""Facets of what is shaded round: a lamp shines on none of them that is turned away, however round the shading."""

from dataclasses import replace

import numpy as np
import pytest
from refine_rig import refined
from rigid_rig import FOCAL, GAP, HEIGHT, START, WIDTH, closed_form, keyframe, lamp, plain, pose, world

from evis.scene.mesh.shapes import sphere
from evis.scene.model import Mesh
from evis.scene.motion import Linear, Prescribed, Spin
from nodes.interpolator.refine.light.facets import width_of
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.renderer.renderer import Renderer

K, TOLERANCE = 4, 20_000
SIDES, RADIUS, AWAY, RATE = 24, 0.5, 1.6, 150.0
UP = np.array([0.0, 1.0, 0.0])
SUN = np.array([1.0, 0.0, -0.1]) / np.hypot(1.0, 0.1)
"""Towards it."""
SKY = 0.02


def drum(sides=SIDES, radius=RADIUS, half=2.0, smooth=True):
    """A prism along y, shaded as a cylinder is."""
    angle = 2 * np.pi * np.arange(sides) / sides
    round_ = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)
    points = np.concatenate([radius * round_ - half * UP, radius * round_ + half * UP]).astype(np.float32)
    n, m = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.concatenate([np.stack([n, m, m + sides], -1), np.stack([n, m + sides, n + sides], -1)])
    normals = np.concatenate([round_, round_])[faces].astype(np.float32)
    return Mesh(points, faces.astype(np.int32), normals=normals if smooth else None)


def spinning(mesh, rate=RATE, shadows=False, camera_motion=None):
    """A thing that turns on its axis before the camera, under a low sun."""
    things = [(mesh, plain(0.5), Prescribed(pose(z=AWAY), [Spin(UP, rate)]))]
    sun = replace(lamp(shadows=shadows), kind="directional", vector=-SUN, colour=np.full(3, 3.0))
    return world(things, camera_motion=camera_motion, lights=[sun], sky=SKY)


def dark_times(columns, times):
    """Whether the side of the drum that each column of the image sees is turned away from the sun, [columns, times];
    times in s. By the ray from the camera, in the plane across the axis, and the nearest side that it meets from
    outside: the one among whose half-planes it enters last."""
    turn = 2 * np.pi * (np.arange(SIDES) + 0.5) / SIDES + RATE * times[:, None]
    normal = np.stack([np.sin(turn), np.cos(turn)], -1)
    across = (columns - world([], lights=[lamp()]).cameras[0].k[0, 2]) / FOCAL
    ray = np.stack([across, np.ones_like(across)], -1)
    slope = np.einsum("tsk,ck->cts", normal, ray)
    inner = RADIUS * np.cos(np.pi / SIDES)
    enter = np.where(slope < 0, (inner + AWAY * normal[..., 1]) / np.where(slope < 0, slope, -1), -np.inf)
    leave = np.where(slope > 0, (inner + AWAY * normal[..., 1]) / np.where(slope > 0, slope, 1), np.inf)
    side = enter.argmax(-1)
    there = np.isfinite(enter.max(-1)) & (enter.max(-1) < leave.min(-1))
    facing = normal @ SUN[[0, 2]]
    return (
        np.where(there, np.take_along_axis(np.broadcast_to(facing, slope.shape), side[..., None], -1)[..., 0], 1) <= 0
    )


def spells(dark):
    """Times [n, 3] at which it is dark between two bright ones: column, first, and one after the last."""
    change = np.diff(dark.astype(np.int8), axis=1)
    found = []
    for column, row in enumerate(change):
        begins, ends = np.flatnonzero(row == 1) + 1, np.flatnonzero(row == -1) + 1
        found += [(column, b, ends[ends > b][0]) for b in begins if (ends > b).any()]
    return np.array(found)


@pytest.mark.parametrize("shadows", [False, True])
def test_every_facet_that_turns_away_is_seen(shadows):
    step = 5_000
    since = np.arange(0, GAP + 1, step)
    dark = spells(dark_times(np.arange(WIDTH), (START + since) * 1e-9))
    low, high = dark[:, 1] * step, dark[:, 2] * step
    frame = GAP // K
    # A frame that it is on tells anyway.
    between = (low // frame == (high - 1) // frame) & (high - low > 4 * TOLERANCE + 2 * step)
    assert between.sum() > 25
    _, (pixels, ns, values) = refined(spinning(drum(), shadows=shadows), K, TOLERANCE)
    dim, seen = values < 1.01 * 0.5 * SKY, []
    for column, begins, ends in np.stack([dark[:, 0], low, high], -1)[between]:
        then = dim & (pixels % WIDTH == column) & (ns > begins - step) & (ns < ends)
        seen.append(np.isin(np.arange(HEIGHT) * WIDTH + column, pixels[then]).mean())
    assert np.mean(seen) > 0.99


def parts_of(scene):
    """Into how many parts a coarse interval is divided for shadows and for facets, and whether that is too few."""
    view = scene.cameras[0]
    rigid = Rigid(scene, view, 1, K, 0, options=RigidOptions(single=True))
    method, found = Refined(rigid, TOLERANCE, 1), []
    light = method.refinement._light_visibility
    parts = light.parts
    light.parts = lambda *given: found.append(parts(*given)) or found[-1]
    renderer = Renderer(scene, view)
    times = [np.array([START - GAP, START]), np.linspace(START, START + GAP, 11).round().astype(np.int64)]
    first, second = (closed_form(scene, t) for t in times)
    a = keyframe(renderer, first, first.pose[:, 0], START)
    b = keyframe(renderer, second, first.pose[:, -1], START + GAP)
    method.between(a, b, [False], np.empty((1, K, view.height, view.width), np.float32))
    (casts, facets), unseen = found[-1]
    return casts[0], facets[0], unseen[0]


@pytest.mark.parametrize(
    ("mesh", "rate", "expected"),
    [
        (drum(), RATE, (0, 64, False)),
        (drum(), 40.0, (0, 16, False)),
        (drum(), 5.0, (0, 0, False)),
        (drum(), 7000.0, (0, 0, True)),
        (drum(smooth=False), RATE, (0, 0, False)),
        (drum(360), RATE, (0, 0, False)),
        (sphere(0.01), RATE, (0, 0, False)),
    ],
    ids=["fast", "slower", "slow", "too fast", "flat", "fine", "small"],
)
def test_as_many_looks_as_facets_come_by(mesh, rate, expected):
    """A side of the drum, 0.13 m wide, is on a point for 1.7 ms at 150 rad/s, and looked at 32 times in that; one that
    is on it for less than 1.5 of the closest looks is counted alone."""
    assert parts_of(spinning(mesh, rate)) == expected


@pytest.mark.parametrize(("speed", "expected"), [(0.0, False), (2_000.0, True)])
def test_the_kernel_is_built_beforehand_where_the_camera_comes_near(speed, expected):
    comes = Prescribed(pose(z=-2_000.0), [Linear(np.array([0.0, 0.0, speed]))])
    scene = spinning(drum(), camera_motion=comes)
    rigid = Rigid(scene, scene.cameras[0], 1, K, 0, options=RigidOptions(single=True))
    built = {kernel.key for kernel, _ in Refined(rigid, TOLERANCE, 1).refinement.kernels()}
    assert any(key.endswith("find_light_changes") for key in built) == expected


def test_the_width_of_triangles_is_that_of_most_of_their_area():
    tall = np.array([[0, 0, 0], [0.1, 0, 0], [0, 5.0, 0]])
    tiny = 0.001 * np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]] * 50)
    assert width_of(np.concatenate([tall[None], tiny])) == pytest.approx(0.1, rel=1e-3)
