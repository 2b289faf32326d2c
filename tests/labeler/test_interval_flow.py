"""Flow over an interval against closed forms: displacement, validity, and there and back again."""

import numpy as np
import pytest
from label_world import HEIGHT, KEYFRAME_NS, WIDTH, seen, states, world

from evis.geometry import distortion, pinhole, se3
from evis.geometry.distortion import Lens
from evis.scene.motion import Linear, Sinusoid, Swing
from nodes.labeler.interval_flow import IntervalFlow
from nodes.labeler.rays.motion_history import MotionHistory
from nodes.labeler.rays.ray_caster import RayCaster

MOVING = [Swing(np.array([0.0, 1.0, 0.0]), 0.1, 2.0), Sinusoid(np.array([0.1, 0.05, 0.0]), 3.0)]
INTERVALS = [(KEYFRAME_NS, 2 * KEYFRAME_NS), (2 * KEYFRAME_NS, KEYFRAME_NS), (40_000_000, 52_345_678)]


def flow_of(scene, start, end, envs=1):
    history, caster = MotionHistory(), RayCaster(scene, scene.cameras[0])
    history.add(states(scene, 3, envs)[2])
    return IntervalFlow(scene, scene.cameras[0], caster)(caster.motion(history), np.arange(envs), start, end)


def expected(scene, start, end):
    """Displacements, where each point is then, and whether it is in view there: planes intersected in float64."""
    pixels = pinhole.pixel_grid(WIDTH, HEIGHT).reshape(-1, 2)
    then, now = np.full(len(pixels), end), np.full(len(pixels), start)
    ids, points = seen(scene, now, pixels[:, 0], pixels[:, 1])
    for number, body in ((2, 0), (3, 1)):
        path, mine = scene.bodies[body].trajectory, ids == number
        points[mine] = se3.transform(
            path.pose(then[mine]), se3.transform(se3.inverse(path.pose(now[mine])), points[mine])
        )
    eye = scene.bodies[-1].trajectory.pose(then)
    there = pinhole.project(scene.cameras[0].k, se3.transform(se3.inverse(eye), points))
    shown, _ = seen(scene, then, there[:, 0], there[:, 1])
    around = [seen(scene, then, there[:, 0] + d, there[:, 1] + e)[0] for d in (-0.01, 0.01) for e in (-0.01, 0.01)]
    sure = np.all([a == shown for a in around], axis=0)
    inside = ((there >= -0.5) & (there <= np.array([WIDTH, HEIGHT]) - 0.5)).all(-1)
    return there - pixels, ids, inside & (shown == ids), sure


@pytest.mark.parametrize("motions", [(), MOVING], ids=["still", "moving"])
@pytest.mark.parametrize(("start", "end"), INTERVALS)
def test_displacement_and_validity_are_those_of_the_closed_form(motions, start, end):
    """Forwards and backwards in time, over a packet and a part of it; valid is in view and not covered."""
    scene = world(motions)
    flow, valid = flow_of(scene, start, end)
    there, ids, wanted, sure = expected(scene, start, end)
    known = ids > 0
    assert np.array_equal(~np.isnan(flow[0, ..., 0].reshape(-1)), known)
    assert np.abs(flow.reshape(-1, 2) - there)[known].max() < 2e-5  # float32 distances at 60 px of focal length
    assert sure.mean() > 0.95 and np.array_equal(valid.reshape(-1)[sure] == 1, (wanted & known)[sure])
    assert 0.05 < 1 - valid.mean() < 0.6


def test_backward_is_the_inverse_of_forward():
    """A point that is visible at both ends: forward flow, and at its place there the closed form of backward."""
    scene = world(MOVING)
    forward, valid = flow_of(scene, *INTERVALS[0])
    backward, _ = flow_of(scene, *INTERVALS[1])
    pixels = pinhole.pixel_grid(WIDTH, HEIGHT)
    there = pixels + forward[0]
    low = np.floor(there).astype(int)
    mine = valid[0].astype(bool) & (low >= 1).all(-1) & (low < np.array([WIDTH, HEIGHT]) - 3).all(-1)
    part = there[mine] - low[mine]
    x, y = low[mine].T
    # Bilinear between four pixels of one surface, whose flow bends little within a pixel.
    rows = [backward[0, y + j, x + i] for j in (0, 1) for i in (0, 1)]
    smooth = np.ptp(rows, axis=0).max(-1) < 0.5
    weights = [
        (part[:, 0] if i else 1 - part[:, 0]) * (part[:, 1] if j else 1 - part[:, 1]) for j in (0, 1) for i in (0, 1)
    ]
    back = sum(w[:, None] * r for w, r in zip(weights, rows))
    assert smooth.sum() > 500 and np.abs(back + forward[0][mine])[smooth].max() < 0.01


def test_nothing_moves_within_an_instant_and_environments_stand_side_by_side():
    scene = world([Linear(np.array([0.3, 0.0, 0.0]))])
    flow, valid = flow_of(scene, KEYFRAME_NS, KEYFRAME_NS, envs=2)
    assert flow.shape == (2, HEIGHT, WIDTH, 2) and valid.dtype == np.uint8
    assert np.abs(flow).max() < 1e-5 and valid.mean() > 0.99 and np.array_equal(flow[0], flow[1])


def test_a_lens_bends_displacements():
    """The occluder crosses at 8 m/s and 1 m: where the lens shows its points 5 ms later, and the wall stays."""
    coefficients = (-0.2, 0.05, 0.0, 0.0, 0.0)
    scene = world(model="plumb_bob", coefficients=coefficients)
    start, end = 40_000_000, 45_000_000
    flow, valid = flow_of(scene, start, end)
    lens, k = Lens.of("plumb_bob", coefficients), scene.cameras[0].k
    rays = distortion.unproject(k, lens, pinhole.pixel_grid(WIDTH, HEIGHT).reshape(-1, 2))
    points = rays / rays[:, 2:]
    centre = scene.bodies[1].trajectory.pose(np.array([start]))[0, :2]
    mine = (np.abs(points[:, :2] - centre) < np.array([0.095, 0.295])).all(1)
    there = distortion.project(k, lens, points + np.array([8.0 * 5e-3, 0.0, 0.0]))
    moved = (there - pinhole.pixel_grid(WIDTH, HEIGHT).reshape(-1, 2))[mine]
    assert mine.sum() > 100 and np.abs(flow.reshape(-1, 2)[mine] - moved).max() < 2e-5
    inside = ((there >= -0.5) & (there <= np.array([WIDTH, HEIGHT]) - 0.5)).all(-1)
    assert np.array_equal(valid.reshape(-1)[mine] == 1, inside[mine])
    corner = flow[0, :4, :4]
    assert np.abs(corner).max() < 1e-5 and valid[0, :4, :4].all()
