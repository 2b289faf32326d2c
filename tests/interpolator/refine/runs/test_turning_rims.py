"""Pixels on the rim of a polygon that turns in place: its corners and sides come and go there between probes."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from passing import NEAR, WALL, rays
from refine_rig import refined
from rigid_rig import GAP, HEIGHT, START, WIDTH, disc, plain, pose, quad, world

from evis.runtime.clock import subframe_stamps
from evis.scene.model import Mesh
from evis.scene.motion import Prescribed, Spin
from nodes.interpolator.refine.rounds import Rounds
from nodes.interpolator.refine.runs.silhouette_kernels import entry_across_side, entry_across_silhouette, entry_then
from nodes.interpolator.refine.window_kernels import WindowParameters, WindowScene, pixel_interval_of
from nodes.renderer.raster.depth_kernels import NO_ENTRY
from nodes.renderer.raster.lens.view_kernels import CameraView

K, TOLERANCE = 4, 20_000
RADIUS, DEPTH, SKY = 0.6, 2.0, 1.0


def covered(scene, sides, rate, since, size=RADIUS):
    """Whether a regular polygon is before each pixel, bool [h w, times]; since: ns since the gap's start.

    In polar coordinates its side is at apothem / cos(angle from the middle of the side).
    """
    seen = DEPTH * rays(scene).reshape(-1, 3)[:, :2]
    radius, angle = np.linalg.norm(seen, axis=1), np.arctan2(seen[:, 1], seen[:, 0])
    turned = angle[:, None] - rate * (START + since) * 1e-9
    sector = 2 * np.pi / sides
    return radius[:, None] <= size * np.cos(sector / 2) / np.cos(turned % sector - sector / 2)


def spells_seen(thing, material, sides, rate, beyond, upsampling=K, size=RADIUS):
    """How many spells of several instants there are beside the rim of a thing that is a regular polygon to the eye, and
    how many are shown."""
    things = [(quad(8.0), plain(WALL), Prescribed(pose(z=4.0)))] if beyond == WALL else []
    turning = Prescribed(pose(z=DEPTH), [Spin(np.array([0.0, 0.0, 1.0]), rate)])
    scene = world([*things, (thing, material, turning)], sky=SKY)
    frames, (pixels, ns, values) = refined(scene, upsampling, TOLERANCE)
    count = HEIGHT * WIDTH
    step = 2_000
    since = np.arange(0, GAP + 1, step)
    shown = covered(scene, sides, rate, since, size)
    change = shown[:, 1:] != shown[:, :-1]
    spells = found = 0
    for q in np.flatnonzero(change.sum(1) > 2):
        own = np.r_[subframe_stamps(0, GAP, upsampling), ns[pixels == q]]
        level = np.r_[frames.reshape(upsampling, count)[:, q], values[pixels == q]]
        order = np.argsort(own)
        ends = np.flatnonzero(change[q])
        for first, last in pairwise(ends):
            # Two instants lie in it at least, however it lies.
            if (last - first) * step > 6 * TOLERANCE:
                middle = (first + last + 1) / 2 * step
                there = np.interp(middle, own[order], level[order])
                spells += 1
                found += (abs(there - NEAR) < abs(there - beyond)) == shown[q, (first + last + 1) // 2]
    return spells, found


@pytest.mark.parametrize(("sides", "rate"), [(40, 150.0), (64, 200.0), (24, -150.0)])
@pytest.mark.parametrize("beyond", [WALL, SKY])
def test_corners_that_come_and_go_beside_a_rim_are_seen(sides, rate, beyond):
    spells, found = spells_seen(disc(RADIUS, sides), plain(NEAR), sides, rate, beyond)
    assert spells > 20
    assert found > 0.95 * spells


def test_a_rim_that_turns_by_a_whole_turn_between_two_frames_is_seen():
    """At both frames each pixel shows the same triangle; what is lost goes on farther from the rim than is looked."""
    sides, size = 20, RADIUS / 2
    spells, found = spells_seen(disc(size, sides), plain(NEAR), sides, 2e9 * np.pi / GAP, SKY, 1, size)
    assert spells > 20
    assert found > 0.88 * spells


def double_cone(radius, sides):
    """Two flat cones base to base, shaded round: the rear one begins at the outline, and faces away."""
    rim = disc(radius, sides)
    height = 0.1 * radius
    front, rear = rim.vertices.copy(), rim.vertices.copy()
    front[0, 2], rear[0, 2] = -height, height
    points = np.concatenate([front, rear])
    faces = np.concatenate([rim.faces[:, ::-1], rim.faces + len(front)])
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return Mesh(points, faces.astype(np.int32), normals=normals[faces].astype(np.float32))


@pytest.mark.parametrize("two_sided", [False, True])
def test_the_outline_of_what_is_round_and_seen_from_outside_alone_is_a_rim_too(two_sided):
    material = replace(plain(NEAR), two_sided=two_sided)
    spells, found = spells_seen(double_cone(RADIUS, 40), material, 40, 150.0, SKY)
    assert spells > 20
    assert found > 0.95 * spells


@wp.kernel
def entries_across(
    view: CameraView,
    params: WindowParameters,
    scene: WindowScene,
    side: int,
    step: int,
    found: wp.array(dtype=wp.uint64),
):
    px = pixel_interval_of(view, params, wp.tid())
    before = entry_then(params, scene, px, 0)
    if side < 0:
        found[wp.tid()] = entry_across_silhouette(view, params, scene, px, 0, step, before)
    else:
        found[wp.tid()] = entry_across_side(view, params, scene, px, side, 0, step, before)


def test_of_several_sides_the_first_that_is_grazed_counts(monkeypatch):
    """On a rim that is aslant the pixels to the right, to the left, below and above are as near to it."""
    run, found = Rounds.run, []

    def looked_at(self, window, *given):
        made = run(self, window, *given)
        v, params, scene = self.evaluator.visibility, window.params, window.scene
        count = window.intervals * params.envs * params.height * params.width
        entries = wp.empty(count, dtype=wp.uint64, device="cpu")
        step = (params.slots + 1) // int(scene.probes.numpy()[0])
        sides = []
        for side in (-1, 0, 1, 2, 3):
            wp.launch(entries_across, count, [v.view, params, scene, side, step, entries], device="cpu")
            sides.append(entries.numpy().copy())
        found.append(np.stack(sides, 1))
        return made

    monkeypatch.setattr(Rounds, "run", looked_at)
    assert spells_seen(disc(RADIUS, 40), plain(NEAR), 40, 150.0, SKY)[0] > 20
    given, *sides = np.concatenate(found).T
    sides = np.stack(sides, 1)
    grazed = sides != int(NO_ENTRY)
    assert (grazed.sum(1) > 1).sum() > 8
    first = np.where(grazed.any(1), sides[np.arange(len(sides)), grazed.argmax(1)], np.uint64(0))
    np.testing.assert_array_equal(given, first)
