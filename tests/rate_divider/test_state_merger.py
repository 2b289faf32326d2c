"""Merged states against engines that publish at the slower rate themselves, and where a group starts anew."""

import numpy as np
import pytest

from evis.config.params import ParamError
from evis.runtime.clock import keyframe_stamp
from evis.scene import load_scene
from msgs.header import Header
from msgs.world import WorldState
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.engines.prescribed import PrescribedEngine
from nodes.physics.interval import Extras
from nodes.rate_divider.merger import Merger
from nodes.rate_divider.node import RateDividerNode

MS = 1_000_000
CONTACTS = ("env", "body", "position", "normal", "force", "distance")
FIELDS = ("t", "end_pose", "moving", "moving_pose", "moving_twist", "episodes", "qpos", "qvel",
          *(f"contact_{n}" for n in CONTACTS))  # fmt: skip


def allocate(**arrays):
    """Nothing that is not written may go unseen."""
    return {name: np.full(shape, -99, dtype) for name, (shape, dtype) in arrays.items()}


def states(engine, rate, count, envs=1):
    """What the physics node publishes at `rate`."""
    result = []
    for k in range(count):
        stamp = keyframe_stamp(k, rate)
        now = engine.advance(stamp) if k else engine.start()
        contacts = {f"contact_{n}": a for n, a in vars(now.contacts).items()} if now.contacts is not None else {}
        result.append(
            WorldState(
                Header(stamp, seq=k), now.t, now.end_pose, now.moving, now.moving_pose, now.moving_twist,
                np.zeros(envs, np.int32), now.qpos, now.qvel, names=["body"], **contacts,
            )
        )  # fmt: skip
    return result


def push_all(merger, given):
    """What comes of it. Every state is spoilt after its call, as the bus may write into it again."""
    made = []
    for state in given:
        made.append(merger.push(state, allocate))
        for name in FIELDS:
            if getattr(state, name) is not None:
                setattr(state, name, np.full_like(getattr(state, name), -7))
    return made


def assert_same(a, b):
    assert (a.header.stamp_ns, a.header.episode, a.names) == (b.header.stamp_ns, b.header.episode, b.names)
    for name in FIELDS:
        x, y = getattr(a, name), getattr(b, name)
        assert (x is None) == (y is None), name
        if x is not None:
            assert x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes(), name


@pytest.mark.parametrize("count", [1, 2, 5])
def test_prescribed_motion_is_that_of_the_slower_rate(count):
    """100 Hz is a multiple of the 1 kHz sub-steps, so both have the same times."""
    scene = load_scene("stereo_room", visuals=False)
    made = push_all(Merger(count), states(PrescribedEngine(scene, 2), 100, 11, 2))
    truth = states(PrescribedEngine(scene, 2), 100 / count, 10 // count + 1, 2)
    published = [m for m in made if m is not None]
    assert [i for i, m in enumerate(made) if m is not None] == list(range(0, 11, count))
    assert len(published) == len(truth)
    for a, b in zip(published, truth):
        a.check()
        assert_same(a, b)


def test_dynamics_with_joints_and_contacts_are_those_of_the_slower_rate():
    """Bodies that fall, hit and slide: sub-steps on one grid whatever the rate, contacts at the last stamp."""
    scene = load_scene("falling_objects", visuals=False)

    def engine():
        return MujocoEngine(scene, 3, 2, extras=Extras(contacts=True, joints=True))

    published = [m for m in push_all(Merger(4), states(engine(), 100, 49, 2)) if m is not None]
    truth = states(engine(), 25, 13, 2)
    assert len(published) == len(truth) == 13 and len(truth[-1].contact_env) > 0
    for a, b in zip(published, truth):
        assert_same(a, b)


def test_stamps_beside_the_grid_stay_and_times_ascend():
    """30 Hz stamps lie between sub-steps: they are one time more, at which the closed form is looked at as well."""
    scene = load_scene("spinning_disk", visuals=False)
    made = [m for m in push_all(Merger(3), states(PrescribedEngine(scene), 30, 7)) if m is not None]
    assert [m.header.stamp_ns for m in made] == [0, 100_000_000, 200_000_000]
    assert made[1].t[0] == 0 and (np.diff(made[1].t) > 0).all() and {33_333_333, 66_666_667} <= set(made[1].t.tolist())
    exact, _ = PrescribedEngine(scene)._states.at(made[1].t)
    np.testing.assert_array_equal(made[1].rows()[0][0], exact)


def simple(t, episode=0, episodes=(0, 0), x=None):
    t = np.atleast_1d(np.asarray(t, np.int64)) * MS
    pose = np.zeros((2, len(t), 1, 7))
    pose[..., 0] = np.arange(len(t))[None, :, None] if x is None else np.asarray(x)[:, :, None]
    header = Header(int(t[-1]), episode=episode)
    return WorldState.dense(header, t, pose, np.zeros((2, len(t), 1, 6)), np.array(episodes, np.int32), names=["ball"])


def stamps(made):
    return [None if m is None else m.header.stamp_ns // MS for m in made]


def test_groups_are_counted_from_the_first_state_of_an_episode():
    given = [simple(0), simple([0, 1]), simple([1, 2]), simple([2, 3])]
    given += [simple(4, 1), simple([4, 5], 1), simple([5, 6], 1), simple([6, 7], 1)]
    merger = Merger(2)
    made = push_all(merger, given)
    assert stamps(made) == [0, None, 2, None, 4, None, 6, None]
    assert [m.header.episode for m in made if m] == [0, 0, 1, 1]
    assert made[4].t.tolist() == [4 * MS] and made[6].t.tolist() == [4 * MS, 5 * MS, 6 * MS]
    assert (merger.gaps, merger.unfinished) == (0, 1)


def test_time_that_goes_back_and_a_missing_state_start_anew():
    merger = Merger(2)
    assert stamps(push_all(merger, [simple(0), simple([0, 1]), simple(0), simple([0, 1]), simple([1, 2])])) == [
        0, None, 0, None, 2,
    ]  # fmt: skip
    assert merger.gaps == 0
    assert stamps(push_all(merger, [simple([3, 4]), simple([4, 5]), simple([5, 6])])) == [4, None, 6]
    assert (merger.gaps, merger.unfinished) == (1, 1)


@pytest.mark.parametrize("at", [0, 1, 2])
def test_an_environment_that_restarts_within_a_group_stands_where_it_ends(at):
    """Environment 1 restarts in message `at` of three; environment 0 keeps its path."""
    group = []
    for i in range(3):
        path = np.array([[i, i + 1.0], [50.0 + i, 51.0 + i]])
        if i == at:
            path[1] = 7.0
        if i > at:
            path[1] = [7.0 + i - at - 1, 7.0 + i - at]
        group.append(simple([i, i + 1], episodes=(0, int(i >= at)), x=path))
    *_, made = push_all(Merger(3), [simple(0), *group])
    assert made.episodes.tolist() == [0, 1]
    np.testing.assert_array_equal(made.rows()[0][0, :, 0, 0], [0, 1, 2, 3])
    np.testing.assert_array_equal(made.rows()[0][1, :, 0, 0], np.full(4, 7.0 + 2 - at))
    assert not (made.rows()[0] == -99).any()


def test_the_group_after_a_restart_is_whole_again():
    first = [simple(0), simple([0, 1], episodes=(0, 1)), simple([1, 2], episodes=(0, 1))]
    later = [simple([2, 3], episodes=(0, 1)), simple([3, 4], episodes=(0, 1))]
    made = push_all(Merger(2), [*first, *later])
    np.testing.assert_array_equal(made[-1].rows()[0][:, :, 0, 0], [[0, 1, 1], [0, 1, 1]])


def test_the_node_says_which_rates_do_not_go_together():
    node = RateDividerNode("divider", {"keyframe_rate": 100, "rate": 30})
    with pytest.raises(ValueError, match=r"30 Hz is no whole fraction of keyframe_rate, 100 Hz; the nearest"):
        node.setup()
    with pytest.raises(ParamError):
        RateDividerNode("divider", {"rate": 0})
