"""Poses of the bodies at the sub-frames against every trajectory's own closed form, and against physics' sub-steps."""

from itertools import pairwise

import numpy as np
import pytest

from evis.geometry import se3
from evis.geometry.interpolate import pose_at
from evis.runtime.clock import keyframe_stamp, subframe_stamps
from evis.scene import load_scene
from evis.scene.model import Body, Scene
from evis.scene.motion import Linear, Path, Prescribed, Sinusoid, Spin, Swing, Turn
from evis.scene.spline import Spline
from msgs.world import moving_bodies
from nodes.interpolator.keyframe import States
from nodes.interpolator.rigid.placement import AHEAD, Placement
from nodes.renderer.geometry.poses import POSE_BYTES

T = np.array([1_000_000_000, 1_005_000_000, 1_010_000_000])


def scene_of(paths):
    return Scene("test", [Body(f"body{n}", path) for n, path in enumerate(paths)], [], [], [], [], np.zeros(3))


def states_of(paths, t=T, envs=1):
    pose, twist = (np.stack([getattr(path, name)(t) for path in paths], 1) for name in ("pose", "twist"))
    return States(t, np.repeat(pose[None], envs, 0), np.repeat(twist[None], envs, 0))


def every_kind(rng):
    """Bodies with every motion there is, alone, several at a time, on each other and standing still."""
    pose = lambda: se3.make_pose(rng.uniform(-1, 1, 3), se3.exp(rng.uniform(-2, 2, 3)))
    axis = lambda: (lambda a: a / np.linalg.norm(a))(rng.uniform(-1, 1, 3))
    times, other = np.array([0.0, 0.7, 1.1, 2.0]), np.array([0.0, 1.5, 3.0])
    path = lambda at, loop: Path(Spline(at, rng.uniform(-1, 1, (len(at), 3)), loop))
    turn = lambda at, loop: Turn(axis(), Spline(at, rng.uniform(-1, 1, len(at)), loop))
    carrier = Prescribed(pose(), [Linear(rng.uniform(-1, 1, 3)), Sinusoid(rng.uniform(-1, 1, 3), 3.0, 0.4)])
    flyer = Prescribed(pose(), [path(times, False), turn(times, False), turn(times, False), turn(other, True)])
    wheel = Prescribed(pose(), [Spin(axis(), 30.0)], carrier)
    unlisted = Prescribed(pose(), [Swing(axis(), 0.7, 2.0, 0.3), path(times, True)])
    return [
        wheel, Prescribed(pose()), carrier, flyer, Prescribed(pose(), [], flyer),
        Prescribed(pose(), [Swing(axis(), 0.5, 4.0), Spin(axis(), -7.0)], wheel),
        Prescribed(pose(), [Sinusoid(rng.uniform(-1, 1, 3), 1.0), Sinusoid(rng.uniform(-1, 1, 3), 2.0)], unlisted),
    ]  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_bodies_worked_out_together_are_where_each_is_alone(seed):
    paths = every_kind(np.random.default_rng(seed))
    stamps = np.linspace(T[0], T[-1], 9).round().astype(np.int64)[1:]
    poses = Placement(scene_of(paths)).at(stamps, states_of(paths, envs=2))
    expected = np.stack([path.pose(stamps) for path in paths], 1)
    np.testing.assert_array_equal(poses, np.repeat(expected[:, None], 2, 1))


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_poses_have_the_same_bits_however_many_gaps_are_computed_at_once(count):
    """One gap after the other or all of them, as `batch` says; of as few sub-frames as one, too."""
    paths = every_kind(np.random.default_rng(9))
    placement = Placement(scene_of(paths))
    ends = [keyframe_stamp(k, 30.0) for k in range(60)]
    stamps = np.stack([subframe_stamps(a, b, count + 1) for a, b in pairwise(ends)])
    together = placement.closed_form(stamps[:, :-1])
    for gap, times in zip(together, stamps):
        alone = placement.moved(times, states_of(paths, times))[:-1, 0]
        assert gap.tobytes() == alone.tobytes()


def test_worlds_that_move_differently_are_where_each_is_alone():
    """Of all environments, and of some of them."""
    worlds = [scene_of(every_kind(np.random.default_rng(seed))) for seed in (11, 12, 13)]
    placement = Placement(worlds[0], worlds, len(worlds))
    stamps = subframe_stamps(int(T[0]), int(T[-1]), 5)
    each = [states_of([body.trajectory for body in world.bodies], stamps) for world in worlds]
    for envs in (None, np.array([2, 0])):
        chosen = range(3) if envs is None else envs.tolist()
        pose, twist = (np.concatenate([getattr(each[e], name) for e in chosen]) for name in ("pose", "twist"))
        found = placement.moved(stamps, States(stamps, pose, twist), envs)
        for row, env in enumerate(chosen):
            paths = [worlds[env].bodies[n].trajectory for n in placement.movers.tolist()]
            np.testing.assert_array_equal(found[:, row], np.stack([path.pose(stamps) for path in paths], 1))


@pytest.mark.parametrize("rate", [30.0, 31.25, 1000 / 7, np.pi, 0.0004])
def test_a_gap_that_was_expected_is_where_the_paths_are(rate):
    """Keyframes are rounded to a nanosecond, gaps are not all of one length; after a pause comes an unexpected one."""
    paths = every_kind(np.random.default_rng(6))
    placement = Placement(scene_of(paths))
    for k in (40, 41, 42, 43, 44, 45, 46, 47, 48, 60, 61):
        ends = np.array([keyframe_stamp(n, rate) for n in (k, k + 1)])
        stamps = subframe_stamps(*ends.tolist(), 8)
        poses = placement.at(stamps, states_of(paths, ends))
        np.testing.assert_array_equal(poses[:, 0], np.stack([p.pose(stamps) for p in paths], 1))
        placement.expect(stamps)


@pytest.mark.parametrize("count", [2, 3, 4, 8, 128])
def test_gaps_that_follow_at_an_even_rate_are_expected_many_at_a_time(count):
    """Each is worked out once, in blocks that grow and are bounded; of few sub-frames, whose rounded times tell the
    length of their gap to a nanosecond, as of many."""
    placement = Placement(load_scene("warehouse", textures=False))
    computed = []
    known = placement._known
    placement._known = lambda stamps: computed.append(stamps) or known(stamps)
    for k in range(100):
        stamps = subframe_stamps(keyframe_stamp(k, 30.0), keyframe_stamp(k + 1, 30.0), count)
        placement.expect(stamps)
        following = subframe_stamps(keyframe_stamp(k + 1, 30.0), keyframe_stamp(k + 2, 30.0), count)
        assert following[:-1].tobytes() in placement._ahead[count]
    sizes = [len(stamps) // (count - 1) for stamps in computed]
    most = max(AHEAD // (23 * (count - 1) * POSE_BYTES), 2)
    # They are as many as there is room for, or have not grown to that.
    assert sizes[:3] == [min(n, most) for n in (2, 4, 8)] and max(sizes) <= most
    assert len(np.unique(np.concatenate(computed))) == sum(map(len, computed))


def test_a_shipped_scene_of_hundreds_of_bodies():
    scene = load_scene("warehouse", {"width": 32, "height": 24})
    paths = [body.trajectory for body in scene.bodies]
    poses = Placement(scene).at(T[1:], states_of(paths))
    assert len(paths) > 100
    np.testing.assert_array_equal(poses[0, 0], np.stack([p.pose(T[1:2])[0] for p in paths]))


def test_bodies_of_physics_lie_between_its_sub_steps_and_what_rests_is_left_alone():
    rng = np.random.default_rng(5)
    paths = every_kind(rng)
    states = states_of(paths, np.linspace(T[0], T[-1], 6).astype(np.int64))
    stamps = np.array([1_003_000_000, 1_007_100_000, T[-1]])
    poses = Placement(scene_of([None] * len(paths))).at(stamps, states)
    expected = pose_at(stamps, states.t, states.pose[0], states.twist[0])
    np.testing.assert_allclose(poses[:, 0], expected, rtol=0, atol=1e-12)  # rounding of angles of some rad
    np.testing.assert_array_equal(poses[-1, 0], expected[-1])
    assert (poses[:, 0, 1] == states.pose[0, 0, 1]).all() and (poses[0, 0, 0] != states.pose[0, 0, 0]).any()


def test_states_that_do_not_reach_back_are_refused():
    paths = every_kind(np.random.default_rng(0))
    with pytest.raises(ValueError, match="poses are known from"):
        Placement(scene_of([None] * len(paths))).at(T - 20_000_000, states_of(paths))


def test_states_of_what_moves_alone_give_the_same_bits():
    paths = every_kind(np.random.default_rng(7))
    t = np.linspace(T[0], T[-1], 6).astype(np.int64)
    dense = states_of(paths, t, envs=2)
    dense.pose[:, :, 2], dense.twist[:, :, 2] = dense.pose[:, -1:, 2], 0.0
    moving = moving_bodies(dense.pose, dense.twist)
    assert 0 < len(moving) < len(paths)
    rows = dense.pose[:, :, moving], dense.twist[:, :, moving]
    sparse = States(t, *rows, moving, dense.pose[:, -1])
    placement = Placement(scene_of([None] * len(paths)))
    stamps = np.array([1_003_000_000, 1_007_100_000, T[-1]])
    assert placement.at(stamps, sparse).tobytes() == placement.at(stamps, dense).tobytes()
    resting = States(t, rows[0][:, :, :0], rows[1][:, :, :0], moving[:0], dense.pose[:, -1])
    assert (placement.at(stamps, resting) == dense.pose[:, -1]).all()
    with pytest.raises(ValueError, match="poses are known from"):
        placement.at(stamps - 20_000_000, resting)


@pytest.mark.parametrize("speed", [0.0, 1e-7, 1.0, 50.0, 3000.0, 12000.0])
def test_poses_of_physics_are_those_of_the_interpolation(speed):
    """Bodies that hardly turn, and that turn more than once from sub-step to sub-step; environments over threads."""
    rng = np.random.default_rng(8)
    envs, count = 40, 3
    t = np.arange(5) * 1_000_000
    seconds = (t * 1e-9)[None, :, None, None]
    omega = rng.normal(size=(envs, 1, count, 3)) * speed
    start = se3.normalize(rng.normal(size=(envs, 1, count, 4)))
    pose = se3.make_pose(rng.normal(size=(envs, 1, count, 3)) + seconds, se3.multiply(se3.exp(omega * seconds), start))
    twist = np.concatenate((np.ones((envs, 5, count, 3)), np.repeat(omega, 5, axis=1)), axis=-1)
    twist += 1e-3 * speed * rng.normal(size=twist.shape)  # no motion is that steady
    stamps = np.array([0, 1, 400_000, 1_000_000, 1_234_567, 3_999_999, 4_000_000])
    states = States(t, pose, twist, np.arange(count), pose[:, -1])
    expected = np.swapaxes(pose_at(stamps, t, pose, twist), 0, 1)
    for threads in (1, 3):
        found = Placement(scene_of([None] * count), envs=envs, threads=threads).at(stamps, states)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * max(1.0, speed / 100))
        np.testing.assert_array_equal(found[[0, 3, 6]], expected[[0, 3, 6]])
