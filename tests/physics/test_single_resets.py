"""Environments that begin anew by themselves: each takes the course of a single run, in time since its own reset."""

import numpy as np
import pytest
from physics_nodes import Wire, node_of

from evis.scene import load_scene
from msgs.header import Header
from msgs.own_time import NUMBER, ORIGIN, SEED, STAMP
from msgs.world import Action, Reset

RATE = 30.0
PARAMS = {"falling_objects": {}, "robot_arm": {"joints": True}, "drone": {}, "spinning_disk": {}}


def stamps(n):
    """Of keyframes, as the design has them."""
    return [round(k * 1e9 / RATE) for k in range(n)]


def step(node, count, controls=None):
    """The next states, under the same controls throughout."""
    before = len(node.runtime.messages)
    for _ in range(count):
        node.step({} if controls is None else {"action": Action(Header(0), controls)})
    return node.runtime.messages[before:]


def course(message, env):
    """What one environment does: own times, poses and twists of all bodies, joints, without repeated sub-steps."""
    t = message.t if message.own_t is None else message.own_t[env]
    kept = np.append(True, np.diff(t) > 0)
    found = [t[kept], *(a[env][kept] for a in message.rows())]
    return found + [a[env][kept] for a in (message.qpos, message.qvel) if a is not None]


def assert_same_course(made, env, single, at=0):
    """From the message `at` on, to the bit."""
    assert len(made) == len(single)
    for mine, other in zip(made, single):
        for a, b in zip(course(mine, env), course(other, at), strict=True):
            assert a.shape == b.shape and a.tobytes() == b.tobytes()


@pytest.mark.parametrize("scene", sorted(PARAMS))
@pytest.mark.parametrize("running", [False, True])
def test_reset_alone_it_takes_the_course_of_a_single_run(scene, running):
    """With a seed of its own, also where stamps are rounded; the others go on as if nothing had been."""
    batch = node_of(scene=scene, envs=4, seed=5, **PARAMS[scene])
    undisturbed = node_of(scene=scene, envs=4, seed=5, **PARAMS[scene])
    single = node_of(scene=scene, seed=77, **PARAMS[scene])
    before, others = step(batch, 5), step(undisturbed, 5)
    if running:
        batch.receive("reset", Reset(Header(0), np.array([2], np.int32), np.array([77])))
        k0, start = 5, step(batch, 1)
        others += step(undisturbed, 1)
    else:
        batch.restart([2], [77])
        k0, start = 4, [batch.runtime.messages[-1]]
        assert start[0].header.stamp_ns == before[-1].header.stamp_ns
    after = step(batch, 7)
    others += step(undisturbed, 7)
    truth = step(single, 8)
    assert_same_course(start + after, 2, truth)
    kept = before + ([] if not running else start) + after
    for env in (0, 1, 3):
        assert_same_course(kept, env, others, env)
    assert [m.header.stamp_ns for m in after] == [round((k0 + j) * 1e9 / RATE) for j in range(1, 8)]
    for j, message in enumerate(start + after):
        own = message.own
        assert own[2].tolist() == [round(j * 1e9 / RATE), stamps(k0 + 1)[k0], 77, 0]
        assert own[1].tolist() == [message.header.stamp_ns, 0, -1, 0]
        assert message.episodes.tolist() == [0, 0, 1, 0]
        assert abs(message.t[-1] - message.header.stamp_ns) == 0 and np.all(np.diff(message.times(2)) >= 0)
        assert abs(int(message.times(2)[-1]) - message.header.stamp_ns) <= 1


def test_until_then_messages_have_no_own_time():
    """So nothing is sent, stored or looked at that was not asked for."""
    for message in step(node_of(scene="falling_objects", envs=2), 3):
        assert message.own is None and message.own_t is None and "own" not in message.arrays()


def test_a_reset_that_keeps_the_seed_begins_otherwise_each_time():
    """By the number of the reset, which counts from the last seed that was given."""
    node = node_of(scene="falling_objects", envs=2, seed=3)
    starts = [step(node, 2)[0].end_pose[1]]
    for _ in range(2):
        node.restart([1])
        starts.append(node.runtime.messages[-1].end_pose[1])
    node.restart([1], [4])  # environment 1 of a run with seed 3 has seed 4
    message = node.runtime.messages[-1]
    assert message.own[1, [SEED, NUMBER]].tolist() == [4, 0] and message.episodes.tolist() == [0, 3]
    assert message.end_pose[1].tobytes() == starts[0].tobytes()
    node.restart([1])
    assert node.runtime.messages[-1].end_pose[1].tobytes() == starts[1].tobytes()
    assert len({s.tobytes() for s in starts}) == 3


def test_a_reset_of_all_starts_time_again():
    """Byte for byte as a new run; without a seed, as its next episode."""
    node, fresh = (node_of(scene="falling_objects", envs=2, seed=seed) for seed in (3, 8))
    step(node, 4)
    node.restart((), [8, 9])
    again = [node.runtime.messages[-1], *step(node, 3)]
    truth = step(fresh, 4)
    for env in (0, 1):
        assert_same_course(again, env, truth, env)
    assert [m.header.stamp_ns for m in again] == stamps(4) and {m.header.episode for m in again} == {1}
    assert again[0].own[:, [STAMP, ORIGIN]].tolist() == [[0, 0], [0, 0]]
    node.restart()
    assert node.runtime.messages[-1].header == Header(0, episode=2)
    assert node.runtime.messages[-1].own[:, NUMBER].tolist() == [1, 1]


def test_before_anything_was_published_it_only_seeds():
    """The first episode stays number 0."""
    node = node_of(scene="falling_objects", seed=3)
    node.restart((), [8])
    first = node.runtime.messages[-1]
    assert first.header == Header(0) and first.episodes.tolist() == [0]
    assert_same_course([first, *step(node, 2)], 0, step(node_of(scene="falling_objects", seed=8), 3))


def test_those_that_are_reset_together_and_again():
    """Two at once, then one of them, then one that never was: every one in its own time."""
    node = node_of(scene="falling_objects", envs=3, seed=1, contacts=True)
    singles = {seed: step(node_of(scene="falling_objects", seed=seed, contacts=True), 12) for seed in (70, 71, 80)}
    step(node, 3)
    node.restart([0, 2], [70, 71])
    first = [node.runtime.messages[-1], *step(node, 4)]
    assert_same_course(first, 0, singles[70][:5])
    assert_same_course(first, 2, singles[71][:5])
    node.restart([2], [80])
    second = [node.runtime.messages[-1], *step(node, 6)]
    assert_same_course(second, 2, singles[80][:7])
    assert_same_course(second[1:], 0, singles[70][5:11])
    last, truth = second[-1], singles[80][6]
    mine = last.contact_env == 2
    assert mine.any() == bool(len(truth.contact_env))
    assert last.contact_force[mine].tobytes() == truth.contact_force.tobytes()
    assert np.all(np.diff(last.contact_env) >= 0)


def test_actions_reach_who_was_reset():
    """Under the same controls the arm moves as in a run of its own."""
    controls = np.tile(np.linspace(-0.4, 0.5, 6), (3, 1))
    node, single = node_of(scene="robot_arm", envs=3), node_of(scene="robot_arm", seed=9)
    controls = controls[:, : node.engine.actuators.count]
    step(node, 1), step(node, 3, controls)
    node.restart([1], [9])
    made = [node.runtime.messages[-1], *step(node, 5, controls)]
    assert_same_course(made, 1, [*step(single, 1), *step(single, 5, controls[:1])])
    with pytest.raises(ValueError, match=r"controls \[2, .*the model takes \[3, "):
        step(node, 1, controls[:2])


def test_one_environment_that_diverges_after_its_reset_is_named(monkeypatch):
    """By its own number, and its episode goes up."""
    node = node_of(scene="falling_objects", envs=3)
    step(node, 2)
    node.restart([2])
    group = node.environments._groups[-1]
    group.engine.data[0].qvel[0] = np.nan
    message = step(node, 1)[0]
    assert message.episodes.tolist() == [0, 0, 2] and message.own[2, NUMBER] == 2
    assert node.runtime.counts["diverged"] == 1 and "environment 2: body" in node.runtime.warnings[-1]
    assert np.isfinite(message.rows()[0]).all()


@pytest.mark.parametrize(
    ("envs", "seeds", "what"),
    [
        ([4], [], r"names environment 4; there are environments 0 to 2"),
        ([-1], [], r"names environment -1"),
        ([1, 1], [], r"environment 1 twice"),
        ([0, 1], [5], r"1 seeds for 2 environments"),
        ([], [5], r"1 seeds for 3 environments"),
        ([0], [-7], r"seed -7 for environment 0"),
    ],
)
def test_what_is_not_there_is_refused_and_the_run_goes_on(envs, seeds, what):
    """One error in the hands of who steps the graph, one warning in a running graph."""
    node = node_of(scene="falling_objects", envs=3)
    step(node, 2)
    with pytest.raises(ValueError, match=what):
        node.restart(envs, seeds)
    node.receive("reset", Reset(Header(0), np.array(envs, np.int32), np.array(seeds, np.int64)))
    assert len(node.runtime.warnings) == 1 and node.runtime.counts["resets_refused"] == 1
    assert step(node, 1)[0].episodes.tolist() == [0, 0, 0]


def test_in_a_running_graph_a_single_environment_begins_an_episode():
    """As it does when it diverges: header and environment count on, time goes on, one instant."""
    node = node_of(scene="falling_objects")
    step(node, 3)
    node.receive("reset", Reset(Header(0), np.zeros(0, np.int32), np.array([6])))
    message = step(node, 1)[0]
    assert message.header == Header(stamps(4)[3], episode=1) and message.t.tolist() == [stamps(4)[3]]
    assert_same_course([message, *step(node, 3)], 0, step(node_of(scene="falling_objects", seed=6), 4))
    assert isinstance(node.runtime, Wire)


def test_a_seed_that_draws_other_bodies_is_refused_and_the_run_goes_on(tmp_path):
    path = tmp_path / "balls.yaml"
    path.write_text(
        "args: {count: {default: {from: 1, to: 4.99}, help: how many}}\n"
        'bodies: {ball: {motion: {kind: spin, axis: [0, 0, 1], rate: 3}, copies: {over: {k: "${count // 1}"}}}}\n'
        "cameras: {cam0: {fov: 50 deg}}\nenvironment: 0.3\n"
    )
    counts = [len(load_scene(str(path), seed=seed).bodies) for seed in range(20)]
    other = next(seed for seed in range(20) if counts[seed] != counts[0])
    node, undisturbed = (node_of(scene=str(path), seed=0) for _ in range(2))
    step(node, 2)
    step(undisturbed, 2)
    node.receive("reset", Reset(Header(0), np.array([], np.int32), np.array([other])))
    assert_same_course(step(node, 2), 0, step(undisturbed, 2))
    (said,) = node.runtime.warnings
    assert f"the bodies of seed {other} are not those that the run has" in said and "nothing is reset" in said
    assert node.runtime.counts["resets_refused"] == 1 and not node.runtime.counts.get("resets")
