"""Labels of events against intersections of planes in closed form and difference quotients of exact motion."""

import numpy as np
import pytest
from label_world import HEIGHT, KEYFRAME_NS, WIDTH, Z, seen, states, world

from evis.geometry import distortion, interpolate, pinhole, se3
from evis.geometry.distortion import Lens
from evis.scene.motion import Linear, Sinusoid, Swing
from nodes.labeler.event_labels import EventLabeler
from nodes.labeler.rays.instants import Instants
from nodes.labeler.rays.motion_history import MotionHistory
from nodes.labeler.rays.ray_caster import RayCaster

STEP = KEYFRAME_NS / 8
MOVING = [Swing(np.array([0.0, 1.0, 0.0]), 0.1, 2.0), Sinusoid(np.array([0.1, 0.05, 0.0]), 3.0)]


def history_of(scene, count=3, envs=1):
    history = MotionHistory()
    for state in states(scene, count, envs):
        history.add(state)
    return history


def questions(n=4000, first=KEYFRAME_NS + 1, seed=0):
    """Random pixels at random times of the second interval."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(first, 2 * KEYFRAME_NS, n))
    return t, rng.integers(0, WIDTH, n), rng.integers(0, HEIGHT, n)


def clear_of_edges(scene, t, x, y):
    """Questions whose neighbours see the same within a hundredth of a pixel: where float32 cannot change the answer."""
    around = [seen(scene, t, x + dx, y + dy)[0] for dx in (-0.01, 0.01) for dy in (-0.01, 0.01)]
    return np.all([a == around[0] for a in around], axis=0)


@pytest.mark.parametrize("motions", [(), MOVING], ids=["still", "moving"])
def test_the_surface_at_an_instant_is_that_of_the_closed_form(motions):
    """Every pixel has a time of its own; at each one instance, and where it is to 1e-6."""
    scene = world(motions)
    t, x, y = questions()
    caster, env = RayCaster(scene, scene.cameras[0]), np.zeros(len(t), np.int32)
    directions = caster.projection.directions(np.stack((x, y), -1).astype(float))
    ids, distances = caster.find_surfaces(caster.motion(history_of(scene)), env, t, directions)
    expected, points = seen(scene, t, x, y)
    sure = clear_of_edges(scene, t, x, y)
    assert sure.mean() > 0.98 and set(np.unique(expected)) >= {1, 2, 3}
    assert np.array_equal(ids[sure], expected[sure])
    length = np.linalg.norm(points - scene.bodies[-1].trajectory.pose(t)[:, :3], axis=-1)
    assert np.abs(distances[sure] / length[sure] - 1).max() < 1e-6


@pytest.mark.parametrize("motions", [(), MOVING], ids=["still", "moving"])
def test_flow_is_that_of_the_point_at_the_events_own_time(motions):
    """Of the point under the pixel, carried along for 1 us either way by the trajectories and projected."""
    scene = world(motions)
    t, x, y = questions()
    made = EventLabeler(RayCaster(scene, scene.cameras[0]), STEP)(history_of(scene), t, x, y, np.array([0, len(t)]))
    expected, points = seen(scene, t, x, y)
    sure = clear_of_edges(scene, t, x, y) & (made.instance == expected)
    assert sure.mean() > 0.8
    ends = []
    for d in (1000, -1000):
        eye = scene.bodies[-1].trajectory.pose(t + d)
        there = points.copy()
        for number, body in ((2, 0), (3, 1)):
            path, mine = scene.bodies[body].trajectory, expected == number
            at = se3.transform(se3.inverse(path.pose(t[mine])), points[mine])
            there[mine] = se3.transform(path.pose(t[mine] + d), at)
        ends.append(pinhole.project(scene.cameras[0].k, se3.transform(se3.inverse(eye), there)))
    flow = (ends[0] - ends[1]) / 2e-6
    scale = np.abs(flow[sure]).max()
    assert scale > 100 and np.abs(made.flow[sure] - flow[sure]).max() < 2e-6 * scale
    # The occluder: f v / z.
    if not motions:
        assert np.allclose(made.flow[sure & (expected == 3)], [60.0 * 8.0 / 1.0, 0.0], atol=1e-3)


def test_a_contour_belongs_to_the_nearer_surface():
    """As it comes and as it goes; elsewhere events belong to what the pixel sees at their time."""
    scene = world()
    t, x, y = questions(20000)
    made = EventLabeler(RayCaster(scene, scene.cameras[0]), STEP)(history_of(scene), t, x, y, np.array([0, len(t)]))
    k = np.ceil(t / STEP)
    three = [seen(scene, at.astype(np.int64), x, y)[0] for at in (t, np.rint((k - 1) * STEP), np.rint(k * STEP))]
    sure = np.all([clear_of_edges(scene, at.astype(np.int64), x, y) for at in (t, (k - 1) * STEP, k * STEP)], axis=0)
    # Of these three, a larger id is nearer.
    nearest = np.max(three, axis=0)
    assert np.array_equal(made.instance[sure], nearest[sure])
    changed = sure & (nearest != three[0])
    assert changed.sum() > 100
    crossing = changed & (nearest == 3)
    assert np.allclose(made.flow[crossing], [480.0, 0.0], atol=1e-3)


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [("plumb_bob", [-0.28, 0.09, 0.001, -0.002, 0.01]), ("equidistant", [-0.03, 0.01, -0.004, 0.0005])],
)
def test_a_lens_bends_rays_and_flow(model, coefficients):
    """The occluder crosses at 8 m/s and 1 m: the derivative of the lens's projection there."""
    scene = world(model=model, coefficients=coefficients)
    t, x, y = questions()
    made = EventLabeler(RayCaster(scene, scene.cameras[0]), STEP)(history_of(scene), t, x, y, np.array([0, len(t)]))
    lens, k = Lens.of(model, coefficients), scene.cameras[0].k
    rays = distortion.unproject(k, lens, np.stack((x, y), -1).astype(float))
    point = rays / rays[:, 2:]
    centre = scene.bodies[1].trajectory.pose(t)[:, :2]
    inside = (np.abs(point[:, :2] - centre) < np.array([0.095, 0.295])).all(1)
    ends = [distortion.project(k, lens, point + np.array([d, 0, 0])) for d in (1e-6, -1e-6)]
    flow = (ends[0] - ends[1]) / 2e-6 * 8.0
    assert inside.sum() > 100 and (made.instance[inside] == 3).all()
    assert np.abs(made.flow[inside] - flow[inside]).max() < 1e-5 * np.abs(flow[inside]).max()


def test_environments_and_an_empty_packet():
    """Events of each environment are looked at in it: here one world twice, so labels repeat."""
    scene = world(MOVING)
    t, x, y = questions(500)
    label, history = EventLabeler(RayCaster(scene, scene.cameras[0]), STEP), history_of(scene, envs=2)
    alone = label(history, t, x, y, np.array([0, 500, 500]))
    both = label(history, np.tile(t, 2), np.tile(x, 2), np.tile(y, 2), np.array([0, 500, 1000]))
    assert both.env.tolist() == [0] * 500 + [1] * 500
    assert np.array_equal(both.instance, np.tile(alone.instance, 2))
    assert np.array_equal(both.flow, np.tile(alone.flow, (2, 1)), equal_nan=True)
    none = label(history, t[:0], x[:0], y[:0], np.zeros(3, np.int64))
    assert none.instance.shape == (0,) and none.flow.shape == (0, 2) and none.instance.dtype == np.int32


def test_motion_in_the_kernel_is_that_of_the_interpolation():
    """Poses between sub-steps of random motion, by where a mesh is seen: against evis.geometry.interpolate."""
    rng = np.random.default_rng(5)
    scene = world([Linear(np.zeros(3)), Swing(Z, 0.0, 1.0)])
    state = states(scene, 2)[1]
    steps, bodies = len(state.t), 3
    pose = np.tile(
        np.array([s.pose(np.zeros(1, np.int64))[0] for s in (b.trajectory for b in scene.bodies)]), (1, steps, 1, 1)
    )
    twist = rng.normal(0, 1, (1, steps, bodies, 6)) * np.array([0.5, 0.5, 0.5, 3, 3, 3])
    pose[..., :3] += rng.normal(0, 1e-3, (1, steps, bodies, 3))
    from msgs.world import WorldState

    history = MotionHistory()
    history.add(WorldState.dense(state.header, state.t, pose, twist, np.zeros(1, np.int32)))
    caster = RayCaster(scene, scene.cameras[0])
    t = np.sort(rng.integers(0, KEYFRAME_NS, 50))
    points = rng.normal(0, 1, (50, 3))
    instants, motion = Instants(scene, scene.cameras[0], caster), caster.motion(history)
    to_mesh = [instants.at(motion, np.zeros(1), int(time)).to_mesh for time in (state.t[0], *t)]
    turn, shift = (np.array([getattr(way, name).numpy()[0, 1] for way in to_mesh]) for name in ("turn", "shift"))
    on_body = points @ turn[0].T + shift[0]
    carried = np.einsum("nji,nj->ni", turn[1:], on_body - shift[1:])
    now = interpolate.pose_at(t, state.t, pose, twist)[0]
    world_points = se3.transform(
        now[:, 0], se3.transform(se3.inverse(pose[0, 0, 0]), se3.transform(pose[0, 0, 2], points))
    )
    assert np.abs(carried - se3.transform(se3.inverse(now[:, 2]), world_points)).max() < 1e-12
