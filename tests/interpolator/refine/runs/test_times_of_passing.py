"""When pixels pass from one surface to another, against closed forms: outlines of what has many triangles, surfaces
that cut each other, and a third thing that shows between two."""

from dataclasses import replace

import numpy as np
import pytest
from passing import NEAR, WALL, rays
from refine_rig import refined
from rigid_rig import GAP, HEIGHT, START, WIDTH, disc, plain, pose, quad, world

from evis.runtime.clock import subframe_stamps
from evis.scene.motion import Linear, Prescribed
from nodes.interpolator.rigid.patches import mesh_neighbours

TOLERANCE = 100_000
K = 4
BETWEEN = 0.5


def moving(x, y, z, velocity, turn=(0.0, 0.0, 0.0)):
    """What is at x, y, z [m] halfway through the gap and moves with a velocity [m/s]."""
    velocity = np.array(velocity, float)
    return Prescribed(pose(*(np.array([x, y, z]) - velocity * (START + GAP / 2) * 1e-9), turn), [Linear(velocity)])


def levels(scene):
    """For each pixel its times [ns] since the gap's start, ascending, frames and samples, and radiance then."""
    frames, (pixels, ns, values) = refined(scene, K, TOLERANCE)
    count = HEIGHT * WIDTH
    pixels = np.concatenate([np.tile(np.arange(count), K), pixels])
    times = np.concatenate([np.repeat(subframe_stamps(0, GAP, K), count), ns])
    values = np.concatenate([frames.reshape(-1), values])
    order = np.lexsort((times, pixels))
    cuts = np.searchsorted(pixels[order], np.arange(1, count))
    return np.split(times[order], cuts), np.split(values[order], cuts)


def errors_of(scene, crossing, level):
    """How far from `crossing` [h, w] [ns], nan = none, the middle is between the last sample above a level and the
    first one below, or the other way round."""
    times, values = levels(scene)
    off = []
    for q in np.flatnonzero(np.isfinite(crossing.reshape(-1))):
        above = values[q] > level
        change = np.flatnonzero(above[1:] != above[:-1])
        true = crossing.reshape(-1)[q]
        off.append(min((abs((times[q][i] + times[q][i + 1]) / 2 - true) for i in change), default=np.inf))
    return np.array(off)


@pytest.mark.parametrize("segments", [9, 40])
def test_the_outline_of_what_has_many_triangles(segments):
    """A disc of triangles about its middle comes over pixels with its rim, at none of the edges between these."""
    speed, radius, depth = 40.0, 0.4, 2.0
    flight = moving(0.3, 0.0, depth, [speed, 0.0, 0.0])
    mesh = disc(radius, segments)
    scene = world([(quad(6.0), plain(WALL), Prescribed(pose(z=4.0))), (mesh, plain(NEAR), flight)], sky=1.0)
    seen = depth * rays(scene)
    # Where a line along x through each pixel cuts the rim ahead.
    rim = np.asarray(mesh.vertices, float)
    rim = rim[np.linalg.norm(rim, axis=1) > radius / 2]
    rim = rim[np.argsort(np.arctan2(rim[:, 1], rim[:, 0]))]
    ahead, behind = np.full((HEIGHT, WIDTH), -np.inf), np.full((HEIGHT, WIDTH), np.inf)
    for a, b in zip(rim, np.roll(rim, -1, axis=0)):
        y = seen[..., 1]
        if a[1] != b[1]:
            inside = (y >= min(a[1], b[1])) & (y <= max(a[1], b[1]))
            params = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            ahead = np.where(inside, np.maximum(ahead, params), ahead)
            behind = np.where(inside, np.minimum(behind, params), behind)
    crossing = (seen[..., 0] - ahead - 0.3) / speed * 1e9 + GAP / 2
    entry_across_silhouette = ~(ahead - behind > 4 * TOLERANCE * 1e-9 * speed)
    crossing[entry_across_silhouette | (crossing < 0) | (crossing > GAP)] = np.nan
    off = errors_of(scene, crossing, (WALL + NEAR) / 2)
    assert len(off) > 300
    assert np.median(off) < 0.02 * TOLERANCE and np.quantile(off, 0.98) < 0.1 * TOLERANCE


def test_surfaces_that_cut_each_other():
    """A slanted square goes away through a wall: the line in which they cut each other passes over the image."""
    speed, slant, depth = 30.0, 0.5, 3.0
    flight = moving(0.0, 0.0, depth, [0.0, 0.0, speed], (0.0, slant, 0.0))
    scene = world([(quad(6.0), plain(WALL), Prescribed(pose(z=depth))), (quad(1.2), plain(NEAR), flight)], sky=1.0)
    d = rays(scene)
    normal = np.array([np.sin(slant), 0.0, np.cos(slant)])
    # On the ray d the wall is at depth d; the square is there too when normal . (depth d - its middle) = 0.
    middle = (depth * (d @ normal)) / normal[2] - depth
    crossing = middle / speed * 1e9 + GAP / 2
    beside = np.abs(depth * d[..., 0]) > 1.0
    crossing[beside | (np.abs(depth * d[..., 1]) > 0.9) | (crossing < 0) | (crossing > GAP)] = np.nan
    off = errors_of(scene, crossing, (WALL + NEAR) / 2)
    assert len(off) > 300
    assert np.median(off) < 0.02 * TOLERANCE and np.quantile(off, 0.98) < 0.1 * TOLERANCE


def test_a_third_thing_between_two():
    """A card goes off; behind its edge a strip shows for less time than lies between two z-buffers, then the wall."""
    speed, width, half = 40.0, 0.018, 0.6
    card = moving(-half, 0.0, 1.0, [-speed, 0.0, 0.0])
    # The edge of the strip, 1.01 m away, is seen `width` beside that of the card, 1 m away.
    strip = moving(1.01 * (width - half), 0.0, 1.01, [-1.01 * speed, 0.0, 0.0])
    things = [(quad(6.0), plain(WALL), Prescribed(pose(z=4.0)))]
    things += [(quad(half), plain(NEAR), card), (quad(1.01 * half), plain(BETWEEN), strip)]
    scene = world(things, sky=1.0)
    d = rays(scene)
    gone = GAP / 2 - d[..., 0] / speed * 1e9
    past = gone + width / speed * 1e9
    assert 4 * TOLERANCE < width / speed * 1e9 < GAP / 8, "between two z-buffers, and not too short"
    times, values = levels(scene)
    shown, late, checked = 0, [], 0
    for q in np.flatnonzero(((gone > 0.02 * GAP) & (past < 0.98 * GAP) & (np.abs(d[..., 1]) < 0.4)).reshape(-1)):
        first, last = gone.reshape(-1)[q], past.reshape(-1)[q]
        if int(first // (GAP / K)) != int(last // (GAP / K)):
            continue
        strip_then = times[q][(values[q] > 0.35) & (values[q] < 0.7)]
        strip_then = strip_then[(strip_then > first - TOLERANCE) & (strip_then < last + TOLERANCE)]
        checked += 1
        shown += len(strip_then) > 0
        if len(strip_then):
            late.append(abs(strip_then.max() - last))
    assert checked > 300 and shown > 0.98 * checked
    assert np.quantile(late, 0.95) < 0.2 * TOLERANCE


def test_what_is_beside_the_triangles_of_a_disc():
    """Across the edge at the rim is nothing, across both others the neighbour."""
    mesh = disc(0.4, 9)
    beside = mesh_neighbours(mesh)
    faces = np.asarray(mesh.faces).reshape(-1, 3)
    for face, row in enumerate(beside):
        for edge, other in enumerate(row):
            ends = {int(faces[face, edge]), int(faces[face, (edge + 1) % 3])}
            shared = [k for k in range(len(faces)) if k != face and ends <= set(faces[k].tolist())]
            assert ([int(other)] if other >= 0 else []) == shared


def test_both_edges_of_what_one_instant_alone_shows():
    """A plate is on each pixel for 0.17 ms, in which there is one instant at most: its light is there from when the
    first edge passes until the second one does, and does not rise all the while."""
    speed, half, depth = 47.0, 0.004, 2.0
    plate = quad(1.0)
    plate = replace(plate, vertices=(plate.vertices * [half, 1, 1]).astype(np.float32))
    flight = moving(0.0, 0.0, depth, [speed, 0.0, 0.0])
    scene = world([(quad(6.0), plain(WALL), Prescribed(pose(z=4.0))), (plate, plain(NEAR), flight)], sky=1.0)
    passing = (depth * rays(scene)[..., 0]) / speed * 1e9 + GAP / 2
    outside = (np.abs(depth * rays(scene)[..., 1]) > 0.9) | (passing < TOLERANCE) | (passing > GAP - TOLERANCE)
    passing[outside] = np.nan
    on = half / speed * 1e9
    for edge in (passing - on, passing + on):
        off = errors_of(scene, edge, (WALL + NEAR) / 2)
        seen = off < on
        assert len(off) > 300 and seen.mean() > 0.95, "there is an instant at which it is seen"
        assert np.quantile(off[seen], 0.98) < 0.1 * TOLERANCE
