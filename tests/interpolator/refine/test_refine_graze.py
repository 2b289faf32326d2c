"""Pixels on the rim of a polygon that turns in place: its corners and sides come and go there between probes."""

from itertools import pairwise

import numpy as np
import pytest
from refine_rig import refined
from rigid_rig import GAP, HEIGHT, START, WIDTH, disc, plain, pose, quad, world
from test_refine_edges import NEAR, WALL, rays

from evis.runtime.clock import subframe_stamps
from evis.scene.motion import Prescribed, Spin

K, TOLERANCE = 4, 20_000
RADIUS, DEPTH, SKY = 0.6, 2.0, 1.0


def covered(scene, sides, rate, since):
    """Whether a regular polygon is before each pixel, bool [h w, times]; since: ns since the gap's start.

    In polar coordinates its side is at apothem / cos(angle from the middle of the side).
    """
    seen = DEPTH * rays(scene).reshape(-1, 3)[:, :2]
    radius, angle = np.linalg.norm(seen, axis=1), np.arctan2(seen[:, 1], seen[:, 0])
    turned = angle[:, None] - rate * (START + since) * 1e-9
    sector = 2 * np.pi / sides
    return radius[:, None] <= RADIUS * np.cos(sector / 2) / np.cos(turned % sector - sector / 2)


@pytest.mark.parametrize(("sides", "rate"), [(40, 150.0), (64, 200.0), (24, -150.0)])
@pytest.mark.parametrize("beyond", [WALL, SKY])
def test_corners_that_come_and_go_beside_a_rim_are_seen(sides, rate, beyond):
    things = [(quad(8.0), plain(WALL), Prescribed(pose(z=4.0)))] if beyond == WALL else []
    wheel = Prescribed(pose(z=DEPTH), [Spin(np.array([0.0, 0.0, 1.0]), rate)])
    scene = world([*things, (disc(RADIUS, sides), plain(NEAR), wheel)], sky=SKY)
    frames, (pixels, ns, values) = refined(scene, K, TOLERANCE)
    count = HEIGHT * WIDTH
    step = 2_000
    since = np.arange(0, GAP + 1, step)
    shown = covered(scene, sides, rate, since)
    change = shown[:, 1:] != shown[:, :-1]
    spells = found = 0
    for q in np.flatnonzero(change.sum(1) > 2):
        own = np.r_[subframe_stamps(0, GAP, K), ns[pixels == q]]
        level = np.r_[frames.reshape(K, count)[:, q], values[pixels == q]]
        order = np.argsort(own)
        ends = np.flatnonzero(change[q])
        for first, last in pairwise(ends):
            # Two instants lie in it at least, however it lies.
            if (last - first) * step > 6 * TOLERANCE:
                middle = (first + last + 1) / 2 * step
                there = np.interp(middle, own[order], level[order])
                spells += 1
                found += (abs(there - NEAR) < abs(there - beyond)) == shown[q, (first + last + 1) // 2]
    assert spells > 20
    assert found > 0.95 * spells
