"""A loop closed through a slower camera: an action is held until the next, and a loop that would wait is refused."""

from pathlib import Path

import numpy as np
import pytest

from evis.config import paths
from evis.config.document import LaunchError
from evis.launch.planner import Options, plan_file
from msgs.header import Header
from msgs.world import Action
from nodes.physics.node import PhysicsNode

CONTROLLER = """
import numpy as np
from evis.runtime.node import Input, Node, Output
from evis.config.params import Param
from msgs.header import Header
from msgs.world import Action

class Controller(Node):
    PARAMS = {"camera": Param(str, "left", "camera that it watches")}
    INPUTS = {"events": Input("/{camera}/events")}
    OUTPUTS = {"action": Output("/action")}
"""


@pytest.fixture
def loop(tmp_path: Path) -> Path:
    (tmp_path / "slow_controller.py").write_text(CONTROLLER)
    path = tmp_path / "loop.yaml"
    path.write_text(
        "args: {scene: {default: stereo_room}, cameras: {default: [left, right]}, watched: {default: right}}\n"
        f"include: {{file: '{paths.find_launch('simulator')[0]}'}}\n"
        "nodes:\n  controller: {type: 'slow_controller:Controller', params: {camera: '${watched}'}}\n"
    )
    return path


@pytest.mark.parametrize(
    ("given", "fits"),
    [
        ({"camera_rate": "right=15"}, False),
        ({"camera_rate": "right=15", "action_rate": "15"}, True),
        ({"camera_rate": "right=15", "action_rate": "7.5"}, True),
        ({"camera_rate": "right=7.5", "action_rate": "15"}, False),
        ({"camera_rate": "right=10", "action_rate": "15"}, False),
        ({"camera_rate": "right=15", "watched": "left"}, True),
        ({}, True),
    ],
)
def test_a_loop_that_would_wait_for_ever_is_refused(loop: Path, given: dict[str, str], fits: bool) -> None:
    if fits:
        plan = plan_file(loop, given, Options(view=False))
        assert [(e.node, e.kind) for e in plan.topics["/action"].edges] == [("physics", "delayed")]
        return
    with pytest.raises(LaunchError, match=r"'controller' publishes it once in \d, .* action_rate:=HZ"):
        plan_file(loop, given, Options(view=False))


def test_an_action_rate_that_does_not_fit_is_named(loop: Path) -> None:
    with pytest.raises(LaunchError, match="action_rate: 20 Hz is no whole fraction of keyframe_rate, 30 Hz"):
        plan_file(loop, {"action_rate": "20"}, Options(view=False))


class Wire:
    """Stands for the executor."""

    def __init__(self) -> None:
        self.joints: list[np.ndarray] = []
        self.sent: list[tuple[int, int]] = []

    def wants(self, node, port, array="") -> bool:
        return True

    def loan(self, node, port, arrays):
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def publish(self, node, port, message) -> None:
        self.sent.append((message.header.episode, message.header.stamp_ns))
        self.joints.append(message.qpos[0, 1:])

    def diagnose(self, *_) -> None: ...

    def count(self, *_) -> None: ...


def course(action_rate: float | None) -> np.ndarray:
    """Joints over 0.16 s at 50 Hz under an action that is new every 40 ms, asked for at 25 or at 50 Hz."""
    params = {"scene": "robot_arm", "keyframe_rate": 50, "duration": 0.16, "joints": True}
    node = PhysicsNode("physics", params | ({"action_rate": action_rate} if action_rate else {}))
    node.runtime = Wire()
    node.setup()
    alive, asked = True, []
    while alive:
        stamps = node.due()
        inputs = {}
        if stamps:
            stamp = stamps["action"]
            asked.append(stamp // 1_000_000)
            value = 0.3 * (1 + stamp // 40_000_000)
            inputs = {"action": Action(Header(stamp), np.full((1, node.engine.actuators.count), value))}
        alive = node.step(inputs)
    assert asked == ([0, 40, 80, 120] if action_rate else [0, 20, 40, 60, 80, 100, 120, 140])
    return np.concatenate(node.runtime.joints)


def test_an_action_is_held_until_the_next() -> None:
    held, renewed = course(25), course(None)
    np.testing.assert_array_equal(held, renewed)
    assert np.abs(held[-1] - held[0]).max() > 0.01, "the arm moves"


FALL = """<mujoco><option timestep="0.001" gravity="0 0 -18000"/><worldbody>
<body name="rock" pos="0 0 0.3"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""


def test_after_a_restart_actions_are_counted_from_it_as_keyframes_are(tmp_path: Path) -> None:
    """A fall that passes the speed limit every 60 ms: the slower camera begins anew there, and so do the actions."""
    (tmp_path / "fall.xml").write_text(FALL)
    params = {"scene": str(tmp_path / "fall.xml"), "keyframe_rate": 100, "duration": 0.2, "joints": True}
    node = PhysicsNode("physics", params | {"action_rate": 25})
    node.runtime = Wire()
    node.setup()
    alive, asked = True, []
    while alive:
        asked += list(node.due().values())
        alive = node.step({})
    sent = node.runtime.sent
    assert len({episode for episode, _ in sent}) > 2, "it restarts"
    first = {episode: stamp for episode, stamp in reversed(sent)}
    assert asked == [stamp for episode, stamp in sent[:-1] if (stamp - first[episode]) % 40_000_000 == 0]
