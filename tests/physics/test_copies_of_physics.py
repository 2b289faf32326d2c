"""What physics goes on from: another node takes the course of one that nobody asked for a copy, to the bit."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from physics_nodes import node_of

from msgs.header import Header
from msgs.own_time import CONFIGURED
from msgs.world import Action, Reset, WorldState
from nodes.physics.node import PhysicsNode

SLEEPING = """<mujoco><option timestep="0.001" sleep_tolerance="1e-3"><flag sleep="enable"/></option><worldbody>
<geom type="plane" size="3 3 .1"/>
<body name="box" pos="0 0 .11"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
<body name="far" pos="0 1 .3"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
<body name="swing" pos="0 3 2"><joint axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 .5 -.5" size=".05"/></body>
<body name="cart" pos="-1 0 .1"><joint name="rail" type="slide" axis="1 0 0" damping="5"/>
<geom size=".09" mass="1"/></body></worldbody><actuator><motor name="push" joint="rail"/></actuator></mujoco>"""
"""Boxes that fall asleep, one of which a cart may be driven into, beside a pendulum that keeps the rest awake."""
RESTING = """<mujoco><option timestep="0.001"/><worldbody><geom type="plane" size="3 3 .1"/>
<body name="box" pos="0 0 .11"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
<body name="cart" pos="-1 0 .1"><joint name="rail" type="slide" axis="1 0 0" damping="5"/>
<geom size=".09" mass="1"/></body></worldbody><actuator><motor name="push" joint="rail"/></actuator></mujoco>"""
"""A box that comes to rest, though MuJoCo would have it creep on."""
FALL = """<mujoco><option timestep="0.001" gravity="0 0 -3000"/><worldbody><body name="rock" pos="0 0 0.5">
<joint name="j" type="slide" axis="0 0 -1"/><geom type="box" size="0.4 0.4 0.4" mass="1"/></body></worldbody></mujoco>
"""
FALLING = """
args: {start: {default: {from: 0, to: 900}, help: speed at the start}}
mjcf: fall.xml
initial_joints: {j: {velocity: "${start}"}}
cameras: {cam0: {position: [0, -3, 1], look_at: [0, 0, 0.5], fov: 50 deg}}
environment: 0.5
"""
"""A fall that passes the speed limit every few gaps, from a speed that is drawn of each environment."""

ALL = {"joints": True, "contacts": True, "accelerations": True}
CASES: list[tuple[str, dict[str, Any], float]] = [
    ("sleeping.xml", {}, 0.1),
    ("sleeping.xml", {"keyframe_rate": 70.0, **ALL}, 0.1),
    ("sleeping.xml", {"threads": 2}, 0.02),
    ("fall.yaml", {}, 0.0),
    ("falling_objects", {}, 0.0),
    ("falling_objects", {"scene_args": "vary=1"}, 0.0),
    ("robot_arm", {"joints": True}, 0.5),
    ("resting.xml", {"keyframe_rate": 8.0}, 0.02),
    ("sleeping.xml", {"physics_tolerance": [1e-2, 1e-1], "keyframe_rate": 300.0}, 0.5),
    ("pong", {"keyframe_rate": 90.0}, 0.7),
    ("drone", {"accelerations": True}, 0.5),
    ("balls", {"scene_args": "vary=1"}, 0.0),
    ("spinning_disk", {"accelerations": True}, 0.0),
]
Entry = tuple[str, Any, Any]


def course_of(rng: np.random.Generator, count: int, envs: int, actuators: int, acting: float) -> list[Entry]:
    """Draws actions, resets at once and resets that wait for the next step."""
    course: list[Entry] = [("step", None, None)]
    for _ in range(count):
        if rng.random() < 0.12:
            chosen = np.sort(rng.choice(envs, rng.integers(1, envs + 1), replace=False))
            seeds = rng.integers(0, 1000, len(chosen)) if rng.random() < 0.5 else np.full(len(chosen), CONFIGURED)
            course.append((("restart", "receive")[rng.integers(2)], chosen, seeds))
        else:
            act = actuators and rng.random() < acting
            course.append(("step", rng.uniform(-1, 1, (envs, actuators)) if act else None, None))
    return course


def gone(node: PhysicsNode, entry: Entry) -> None:
    what, first, seeds = entry
    if what == "restart":
        node.restart(first, seeds)
    elif what == "receive":
        node.receive("reset", Reset(Header(0), first.astype(np.int32), seeds))
    else:
        node.step({} if first is None else {"action": Action(Header(0), controls=first)})


def content(message: WorldState) -> tuple[Any, ...]:
    arrays = {name: (a.dtype.str, a.shape, a.tobytes()) for name, a in message.arrays().items()}
    return message.header.stamp_ns, message.header.episode, arrays


def told(node: PhysicsNode) -> tuple[Any, ...]:
    return [content(message) for message in node.runtime.messages], node.runtime.warnings, node.runtime.counts


@pytest.mark.parametrize("envs", [1, 3])
@pytest.mark.parametrize(("scene", "more", "acting"), CASES, ids=str)
def test_another_node_goes_on_as_if_nothing_had_been(
    tmp_path: Path, scene: str, more: dict[str, Any], acting: float, envs: int
) -> None:
    files = {"sleeping.xml": SLEEPING, "resting.xml": RESTING, "fall.xml": FALL, "fall.yaml": FALLING}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    params = {"scene": str(tmp_path / scene) if scene in files else scene, "envs": envs, "seed": 3, **more}
    rng = np.random.default_rng(len(scene) + 7 * envs)
    single, copied, other = node_of(**params), node_of(**params), node_of(**params)
    actuators = single.engine.actuators.count
    course = course_of(rng, 24, envs, actuators, acting)
    for cut in (3, 9, 17, 21):
        for node in (single, copied, other):
            assert node.rewind(node.params)
        for entry in course[:cut]:
            gone(single, entry)
            gone(copied, entry)
        kept, state = copied.kept(), copied.state()
        single.runtime.__init__()
        for entry in course[cut:]:
            gone(single, entry)
        worst = single.errors.worst()
        # Once by the node itself after what it has done since, and twice by another one.
        for entry in course[: cut // 2]:
            gone(copied, entry)
        for node in (copied, other, other):
            assert node.rewind(node.params)
            node.go_on(kept)
            node.restore(state)
            node.runtime.__init__()
            for entry in course[cut:]:
                gone(node, entry)
            assert told(node) == told(single)
            assert node.errors.worst() == worst
            assert node.engine.missed() == single.engine.missed()
            assert len(node.runtime.messages) > 1


def test_a_copy_changes_nothing(tmp_path: Path) -> None:
    """A node that is asked for copies all the time takes the course of one that is not."""
    (tmp_path / "sleeping.xml").write_text(SLEEPING)
    asked, single = (node_of(scene=str(tmp_path / "sleeping.xml"), envs=3, contacts=True) for _ in range(2))
    for _ in range(60):
        asked.step({})
        asked.kept()
        single.step({})
    assert told(asked) == told(single)


def test_bodies_that_sleep_are_among_what_was_tried(tmp_path: Path) -> None:
    """Of a copy from between two steps that a batch takes ahead those steps are part, where a body sleeps."""
    (tmp_path / "sleeping.xml").write_text(SLEEPING)
    node = node_of(scene=str(tmp_path / "sleeping.xml"), envs=3)
    for _ in range(60):
        node.step({})
    each = node.kept().environments.groups[0].engine.data.values()
    assert all((kept.data.tree_asleep >= 0).any() for kept in each)
    # The first one is looked at before that, for its errors.
    assert [kept.taken is not None for kept in each] == [False, True, True]


def test_an_action_right_behind_a_copy_takes_back_the_steps_ahead_of_it(tmp_path: Path) -> None:
    """So it does where bodies sleep, of which such steps are kept."""
    (tmp_path / "sleeping.xml").write_text(SLEEPING)
    single, other = (node_of(scene=str(tmp_path / "sleeping.xml"), envs=3) for _ in range(2))
    held = Action(Header(0), controls=np.zeros((3, 1)))
    for _ in range(30):
        single.step({"action": held})
    kept = single.kept()
    other.go_on(kept)
    push = np.array([[0.0], [0.9], [-0.9]])
    for node in (single, other):
        node.runtime.messages.clear()
        for _ in range(10):
            node.step({"action": Action(Header(0), controls=push)})
    assert told(other)[0] == told(single)[0]
    assert any(of.taken is not None for of in kept.environments.groups[0].engine.data.values())


def test_parts_of_steps_go_on_as_many_as_they_were() -> None:
    """Steps that were taken in many parts are so right behind a copy, and those not exact enough stay counted."""
    node, other = (node_of(scene="robot_arm", physics_tolerance=[1e-7, 1e-6], keyframe_rate=1000.0) for _ in range(2))
    for _ in range(8):
        node.step({})
    other.go_on(node.kept())
    assert other.engine.missed() == node.engine.missed() > 0


def test_errors_are_looked_at_after_an_environment_was_reset_and_then_all() -> None:
    node = node_of(scene="robot_arm", envs=2)
    found = []
    for reset in (False, True, False):
        for _ in range(4):
            node.step({})
        found.append(node.errors.worst())
        if reset:
            node.restart([0])
        assert node.rewind(node.params)
    assert found[0] is not None and found[0].position > 0 and found[1:] == found[:1] * 2
