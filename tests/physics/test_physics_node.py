"""The node: one message per keyframe stamp, by the rules of /state, and nothing imported that is not needed."""

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from physics_nodes import node_of

from evis.config.params import ParamError
from evis.scene import load_scene
from msgs.header import Header
from msgs.world import Action
from nodes.physics.engines.prescribed import PrescribedEngine
from nodes.physics.environments.told_together import told_together
from nodes.physics.node import PhysicsNode


def run(node):
    while node.step({}):
        pass
    return node.runtime.messages


@pytest.mark.parametrize("rate, duration, count", [(30, 1.0, 31), (125, 0.1, 13), (30, 0.0999, 3), (1000, 0.002, 3)])
def test_stamps_and_sub_steps(rate, duration, count):
    """All k with stamp <= duration; S = 1 at first, then from the previous stamp to this one, 1 ms apart at most."""
    messages = run(node_of(scene="spinning_disk", keyframe_rate=rate, duration=duration))
    assert [m.header.stamp_ns for m in messages] == [round(k * 1e9 / rate) for k in range(count)]
    assert messages[0].t.tolist() == [0]
    for before, message in pairwise(messages):
        assert message.t[0] == before.header.stamp_ns and message.t[-1] == message.header.stamp_ns
        assert np.all((np.diff(message.t) > 0) & (np.diff(message.t) <= 1_000_000))
        assert np.array_equal(message.rows()[0][:, 0], before.end_pose)
    assert messages[0].names == ["disk", "cam0"] and {m.header.episode for m in messages} == {0}


def test_prescribed_poses_are_exact_and_alike_in_all_environments():
    """The disk's rotation at every sub-step is omega t about its axis, in closed form."""
    messages = run(node_of(scene="spinning_disk", scene_args="omega=15,centre=0.1,-0.1", envs=3, duration=0.2))
    scene = load_scene("spinning_disk", {"omega": 15, "centre": "0.1,-0.1"}, textures=False)
    for message in messages:
        message.check()
        assert message.moving.tolist() == [0]
        pose, twist = message.rows()
        for e in range(3):
            for n, body in enumerate(scene.bodies):
                assert np.array_equal(pose[e, :, n], body.trajectory.pose(message.t))
                assert np.array_equal(twist[e, :, n], body.trajectory.twist(message.t))
    assert np.allclose(twist[0, 0, 0, 3:] @ twist[0, 0, 0, 3:], 15**2)


def test_without_duration_it_goes_on():
    """duration 0 means until stopped."""
    node = node_of(scene="spinning_disk", duration=0)
    assert all(node.step({}) for _ in range(50))


SLIDE = """<mujoco><option gravity="0 0 0"/><worldbody><body name="slide"><joint name="j" type="slide" axis="1 0 0"/>
<geom size=".1" mass="1"/></body></worldbody><actuator><motor joint="j"/></actuator></mujoco>"""


@pytest.mark.parametrize("params", [{}, {"timestep": 1e-4}, {"action_rate": 1e3}, {"physics_tolerance": [1e-3, 1e-3]}])
def test_actions_that_no_step_follows_are_told(params, tmp_path):
    """1 N forwards and back in turn, 10,000 times a second, on 1 kg: the velocity is the sum of the impulses, or it is
    told that most of them never act, with the steps and the rate by which they do."""
    (tmp_path / "slide.xml").write_text(SLIDE)
    node = node_of(scene=str(tmp_path / "slide.xml"), keyframe_rate=1e4, **params)
    interval, sign, impulse = 1e-9 * 100_000 * node.held, 1.0, 0.0
    node.step({})
    for k in range(100):
        action = {}
        if node.due():
            sign = -sign if k else 1.0
            impulse += sign * interval
            action = {"action": Action(Header(k * 100_000, 0), np.array([[sign]]))}
        node.step(action)
    velocity = node.runtime.messages[-1].rows()[1][0, -1, 0, 0]
    told = [text for text in node.runtime.warnings if "act at all" in text]
    if node.held * 1e-4 >= params.get("timestep", 1e-3):
        assert told == [] and abs(velocity - impulse) < 1e-12
    else:
        assert abs(velocity - impulse) > 1e-3
        (text,) = told
        assert (
            "only 0.1 of them" in text
            and "timestep:=0.0001 " in text
            and text.endswith("action_rate:=1000 each step an action")
        )


def test_planner_learns_that_mujoco_is_not_needed():
    """With the reason, from the scene file alone."""
    assert "prescribed" in PhysicsNode.imports({"scene": "spinning_disk"})["mujoco"]
    assert PhysicsNode.imports({"scene": "falling_objects"}) == {}


def test_prescribed_scenes_import_neither_mujoco_nor_warp():
    """In a fresh interpreter, after setup and steps."""
    code = (
        "import sys; sys.path.insert(0, 'tests/physics'); from physics_nodes import node_of; "
        "node = node_of(scene='spinning_disk', duration=0.1); node.step({}); node.step({}); "
        "sys.exit(' '.join({'mujoco', 'warp'} & set(sys.modules)) or 0)"
    )
    root = __file__.rsplit("/tests/", 1)[0]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


def test_same_seed_same_bytes_with_contacts_and_joints():
    """Every array of every message of falling_objects, twice."""
    params = dict(scene="falling_objects", duration=0.6, contacts=True, joints=True, seed=4, envs=2)
    a, b = run(node_of(**params)), run(node_of(**params))
    for x, y in zip(a, b, strict=True):
        assert x.arrays().keys() == y.arrays().keys() and "contact_force" in x.arrays() and "qpos" in x.arrays()
        assert all(x.arrays()[n].tobytes() == y.arrays()[n].tobytes() for n in x.arrays())
    assert len(a[-1].contact_env) and set(a[-1].contact_env) == {0, 1}


def test_nothing_is_extracted_unless_asked():
    """No contacts and no joints by default."""
    message = run(node_of(scene="falling_objects", duration=0.1))[-1]
    assert set(message.arrays()) == {"t", "end_pose", "moving", "moving_pose", "moving_twist", "episodes", "gravity"}


CART = """<mujoco><option gravity="0 0 0"/><worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
<geom size=".1" mass="1"/></body></worldbody><actuator><motor joint="x"/></actuator></mujoco>"""


def test_an_action_acts_on_the_step_that_starts_at_its_stamp(tmp_path):
    """due() asks for the previous stamp; before the first there is none, and the controls are zero."""
    path = tmp_path / "cart.xml"
    path.write_text(CART)
    node = node_of(scene=str(path), keyframe_rate=100, duration=0.03)
    assert node.due() == {}
    node.step({})
    speeds = []
    for force in (1.0, 0.0, -1.0):
        stamp = node.due()["action"]
        assert stamp == node.runtime.messages[-1].header.stamp_ns
        node.step({"action": Action(Header(stamp), np.full((1, 1), force))})
        speeds.append(node.runtime.messages[-1].end_twist()[0, 0, 0])
    assert np.allclose(speeds, [0.01, 0.01, 0.0], atol=1e-12)


def test_divergence_ends_the_episode_and_is_said(tmp_path, monkeypatch):
    """For one environment the header's episode goes up and the message stands alone (S = 1)."""
    monkeypatch.chdir(tmp_path)
    stiff = CART.replace('axis="1 0 0"', 'axis="1 0 0" stiffness="1e8" springref="0.01"')
    (tmp_path / "stiff.xml").write_text(stiff)
    node = node_of(scene="stiff.xml", keyframe_rate=50, duration=0.04)
    messages = run(node)
    assert [m.header.episode for m in messages] == [0, 1, 2]
    assert [len(m.t) for m in messages] == [1, 1, 1] and [m.episodes.tolist() for m in messages] == [[0], [1], [2]]
    assert [m.header.stamp_ns for m in messages] == [0, 20_000_000, 40_000_000]
    assert node.runtime.counts["diverged"] == 2
    faults = [text for text in node.runtime.warnings if "environment 0: body 'cart' diverged" in text]
    assert len(faults) == 2 and all("omega*dt = 10" in text for text in faults)
    assert "expect it to diverge" in node.runtime.warnings[0]  # said before the first step
    assert all(np.isfinite(m.rows()[0]).all() for m in messages)


def test_wrong_parameters_say_what_is_right():
    """A missing scene, a wrong argument of the scene, a wrong parameter of the node."""
    with pytest.raises(ValueError, match="physics needs scene:=NAME"):
        node_of()
    with pytest.raises(ValueError, match="no parameter 'omga'; did you mean 'omega'"):
        node_of(scene="spinning_disk", scene_args="omga=50")
    with pytest.raises(ParamError, match="did you mean 'keyframe_rate'"):
        node_of(scene="spinning_disk", keyframe_rat=30)


def test_grid_is_independent_of_stamps():
    """A body's sub-steps lie at whole milliseconds whatever the stamps are."""
    engine = PrescribedEngine(load_scene("spinning_disk", textures=False))
    engine.start()
    assert engine.advance(2_500_000).t.tolist() == [0, 1_000_000, 2_000_000, 2_500_000]
    assert engine.advance(2_600_000).t.tolist() == [2_500_000, 2_600_000]
    assert engine.advance(4_000_000).t.tolist() == [2_600_000, 3_000_000, 4_000_000]


def test_what_diverges_for_ever_is_told_of_some_times_and_counted_always(tmp_path):
    spring = "<joint name='spring' type='slide' stiffness='1e8' springref='.01'/><geom size='.1' mass='1'/>"
    option, body = "<option timestep='.001' gravity='0 0 0'/>", f"<body name='a'>{spring}</body>"
    text = f"<mujoco>{option}<worldbody>{body}</worldbody></mujoco>"
    (tmp_path / "m.xml").write_text(text)
    node = node_of(scene=str(tmp_path / "m.xml"), envs=7, keyframe_rate=100.0, duration=0.25)
    assert run(node)[-1].episodes.tolist() == [25] * 7
    assert node.runtime.counts["diverged"] == 175
    told = [text for text in node.runtime.warnings if "diverged at" in text]
    assert len(told) == 20
    assert [text.endswith("; from now on such faults are only counted (diverged)") for text in told] == [False] * 19 + [
        True
    ]


def test_what_several_environments_have_is_told_once(tmp_path, monkeypatch):
    """One line with their numbers, each time, and every one of them is counted."""
    monkeypatch.chdir(tmp_path)
    stiff = CART.replace('axis="1 0 0"', 'axis="1 0 0" stiffness="1e8" springref="0.01"')
    (tmp_path / "stiff.xml").write_text(stiff)
    node = node_of(scene="stiff.xml", keyframe_rate=50, duration=0.04, envs=12)
    messages = run(node)
    assert messages[-1].episodes.tolist() == [2] * 12 and node.runtime.counts["diverged"] == 24
    faults = [text for text in node.runtime.warnings if "body 'cart' diverged" in text]
    assert [text[: text.index(":")] for text in faults] == ["environments 0, 1, 2, 3, 4, 5, 6, 7, ... (12)"] * 2
    assert "each starts again as episode 1 at 0.02 s" in faults[0] and "episode 2 at 0.04 s" in faults[1]


def test_lines_that_differ_in_numbers_alone_are_one():
    found = [(0, "a is 2.5 m off"), (3, "a is 1e-3 m off"), (1, "b is 2 m off"), (3, "b is 2 m off")]
    assert told_together(found) == [
        ([0, 3], "a is 2.5 m off (of environment 0; others differ in numbers)"),
        ([1, 3], "b is 2 m off"),
    ]
    assert told_together([]) == []
