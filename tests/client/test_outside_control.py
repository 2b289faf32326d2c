"""A program that controls a running simulation: as a controller inside would, alone, and only as long as it lives."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.client import Run
from msgs.header import Header
from msgs.world import Action
from nodes.physics.node import PhysicsNode

ROOT = Path(__file__).parents[2]
LIMIT_S = 60.0
PHYSICS = """
mode: MODE
nodes:
  physics: {type: physics, keep: [state], params: {scene: SCENE, keyframe_rate: 50, joints: JOINTS, envs: ENVS}}
"""
CONTROLLER = """
  controller: {type: "arm_controller:Controller"}
"""


def until(condition: Callable[[], Any]) -> Any:
    """Wait for something true, and give it."""
    end = time.monotonic() + LIMIT_S
    while not (value := condition()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)
    return value


class Launched:
    """`evis launch` of a graph, and what it says to its user."""

    def __init__(self, folder: Path, *words: str) -> None:
        self.log = folder / "log"
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "evis", "launch", *words], stdout=log, stderr=log, cwd=folder,
                env={**os.environ, "PYTHONPATH": str(folder)},
            )  # fmt: skip

    def said(self, text: str) -> str:
        """The line with this text, once it is there."""
        return until(lambda: next((line for line in self.log.read_text().splitlines() if text in line), None))

    def end(self) -> str:
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(LIMIT_S) == 0, self.log.read_text()
        return self.log.read_text()


@pytest.fixture
def launch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Launched]]:
    """Start a graph of physics alone, or what the words say, in a run directory that nobody else sees."""
    runtime = Path(tempfile.mkdtemp(prefix="ev", dir="/tmp"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    started: list[Launched] = []

    def start(*words: str, mode: str = "lockstep", scene: str = "robot_arm", envs: int = 1, more: str = "") -> Launched:
        folder = tmp_path / f"graph{len(started)}"
        folder.mkdir()
        if not words:
            text = PHYSICS.replace("MODE", mode).replace("SCENE", scene).replace("ENVS", str(envs))
            text = text.replace("JOINTS", "true" if scene == "robot_arm" else "false")
            (folder / "arm.yaml").write_text(text + more)
        started.append(Launched(folder, *(words or ("arm.yaml",))))
        return started[-1]

    yield start
    for graph in started:
        if graph.process.poll() is None:
            graph.process.kill()
            graph.process.wait()
    shutil.rmtree(runtime, ignore_errors=True)


class Wire:
    """Stands for the executor of a physics node that a test steps."""

    def __init__(self) -> None:
        self.joints: dict[int, np.ndarray] = {}

    def wants(self, node: Any, port: str) -> bool:
        return True

    def loan(self, node: Any, port: str, arrays: Any) -> dict[str, np.ndarray]:
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def publish(self, node: Any, port: str, message: Any) -> None:
        self.joints[message.header.stamp_ns] = np.array(message.qpos)

    def diagnose(self, *_: Any) -> None: ...

    def count(self, *_: Any) -> None: ...


def alone(actions: dict[int, np.ndarray], until_ns: int, **params: Any) -> dict[int, np.ndarray]:
    """Joints at every stamp of a physics node that has these actions at these stamps, and else keeps the last."""
    node = PhysicsNode("physics", {"scene": "robot_arm", "keyframe_rate": 50, "joints": True, **params})
    wire = Wire()
    node.runtime = wire  # type: ignore[assignment]
    node.setup()
    while until_ns not in wire.joints:
        stamp = node.due().get("action")
        node.step({"action": Action(Header(stamp), actions[stamp])} if stamp in actions else {})
    return wire.joints


def wave(k: int, envs: int = 1) -> np.ndarray:
    return np.sin(np.arange(6) + 0.2 * k + np.arange(envs)[:, None])


@pytest.mark.parametrize("envs", [1, 3])
def test_in_lockstep_it_is_as_if_it_were_inside(launch: Callable[..., Launched], envs: int) -> None:
    """Byte for byte the course of a node that is stepped with the same actions, from takeover to hand-back."""
    graph = launch(envs=envs)
    given: dict[int, np.ndarray] = {}
    seen: dict[int, np.ndarray] = {}
    with evis.connect(wait_s=LIMIT_S) as run:
        states = run.topic("/state")
        first = run.take()
        assert run.due() == first
        assert run.actuators[1] == ("shoulder", pytest.approx(-np.pi / 2, rel=1e-3), pytest.approx(np.pi / 2, rel=1e-3))
        for k in range(25):
            controls = 1.4 * wave(k, envs)
            given[run.act(controls, stamp_ns=run.due())] = controls
            state = states.read(LIMIT_S)
            while state.header.stamp_ns <= max(given):
                seen[state.header.stamp_ns] = state.qpos
                state = states.read(LIMIT_S)
            seen[state.header.stamp_ns] = state.qpos
        assert states.lost == 0
    text = graph.end()
    assert sorted(given) == list(range(first, first + 25 * 20_000_000, 20_000_000))
    expected = alone(given, max(seen), envs=envs)
    assert len(seen) > 25
    for stamp, joints in seen.items():
        np.testing.assert_array_equal(joints, expected[stamp])
    assert f"controls /action from {first / 1e9:.6g} s on: every step waits" in text and "has left /action" in text


def test_in_realtime_the_latest_action_holds(launch: Callable[..., Launched]) -> None:
    graph = launch(mode="realtime")
    target = np.array([0.5, 0.2, 0.4, 0.0, 0.3, 0.0])
    with evis.connect(wait_s=LIMIT_S) as run:
        states = run.topic("/state")
        began = run.act(target)
        assert run.lockstep is False
        with pytest.raises(ValueError, match="no step of arm waits for this program"):
            run.due()
        seen = {s.header.stamp_ns: s.qpos for s in (states.read(LIMIT_S) for _ in range(30))}
        assert max(seen) > began
        expected = alone({began: target[None]}, max(seen))
        for stamp, joints in seen.items():
            np.testing.assert_array_equal(joints, expected[stamp])
        with pytest.raises(ValueError, match="an action for 0 s is late"):
            run.act(target, stamp_ns=0)
        with pytest.raises(ConnectionRefusedError, match="keeps to the wall clock"):
            run.take(lockstep=True)
    assert "its latest action holds" in graph.end()


BAD = [
    ([1, 2], r"controls \[1, 2\], the model takes \[1, 6\] \(environments, actuators: yaw, shoulder"),
    ([0, 0, 0, np.nan, 0, 0], "nan for actuator 'forearm_roll' of environment 0; it must be finite"),
    ([0, 2, 0, 0, 0, 0], "2 for actuator 'shoulder' of environment 0; its range is -1.571 to 1.571"),
    ("up", "6 number"),
    (np.zeros((1, 1, 6)), r"shape \[1, 1, 6\]"),
]


BAD_RESETS: list[dict[str, Any]] = [
    {"envs": [True]}, {"envs": [0.7]}, {"seed": -2}, {"seed": 1.5}, {"seed": "a"}, {"seed": [2**64]},
]  # fmt: skip
"""What is refused before it is sent: it would have been taken for something else."""


def test_bad_input_is_named_and_physics_goes_on(launch: Callable[..., Launched]) -> None:
    graph = launch()
    with evis.connect(wait_s=LIMIT_S) as run:
        first = run.take()
        for values, why in BAD:
            with pytest.raises(ValueError, match=why):
                run.act(values)
        for stamp, why in ((first - 1, "is late"), (first + 1, "is too early")):
            with pytest.raises(ValueError, match=why):
                run.act(np.zeros(6), stamp_ns=stamp)
        for kind in ({"envs": [1]}, {"envs": [0, 0]}, {"envs": []}, {"seed": [1, 2]}, *BAD_RESETS):
            with pytest.raises(ValueError):
                run.reset(**kind)
        with pytest.raises(ValueError, match="the graph has no topic '/cam0/events'"):
            run.topic("/cam0/events")
        assert run.act(np.zeros(6)) == first
        assert run.act(np.zeros(6)) == first + 20_000_000
    text = graph.end()
    assert len([line for line in text.splitlines() if "refused from" in line]) == 1
    assert "refused_actions=5" in text and "outside_actions=2" in text and "refused_resets=3" in text


KILLED = """
import evis
with evis.connect() as run:
    print(run.take(), flush=True)
    run.act([0.1] * 6)
    run.due()
    print("acted", flush=True)
    import time; time.sleep(1000)
"""


def test_a_controller_that_is_killed_hands_control_back(launch: Callable[..., Launched]) -> None:
    graph = launch()
    with evis.connect(wait_s=LIMIT_S) as run:
        script = Path(tempfile.mkdtemp(dir=graph.log.parent)) / "mover.py"
        script.write_text(KILLED)
        other = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
        assert other.stdout is not None
        first = int(other.stdout.readline())
        assert other.stdout.readline() == "acted\n"
        with pytest.raises(
            ConnectionRefusedError, match=rf"mover.py \(process {other.pid}, outside\) controls /action"
        ):
            run.take()
        states = run.topic("/state")
        other.kill()
        other.wait()
        assert states.read(LIMIT_S).header.stamp_ns > first  # physics goes on
        line = graph.said("is gone without a word")
        assert "mover.py" in line and f"from {(first + 20_000_000) / 1e9:.6g} s on its last action holds" in line
        assert run.take() > first  # and can be had again
    graph.end()


def test_a_closed_connection_says_so(launch: Callable[..., Launched]) -> None:
    """It would take control anew, and nobody would hand it back."""
    graph = launch(mode="realtime")
    with evis.connect(wait_s=LIMIT_S) as run:
        run.act(np.zeros(6))
    graph.said("has left /action")
    for call in (lambda: run.act(np.zeros(6)), run.take, run.reset, lambda: run.topic("/state")):
        with pytest.raises(ConnectionError, match=r"was closed; evis\.connect\(\) makes another"):
            call()
    run.close()
    assert graph.end().count("controls /action") == 1


def test_a_reset_from_outside(launch: Callable[..., Launched]) -> None:
    """The state at the next stamp is the start, one episode on; actions are for it as for any other."""
    graph = launch(envs=2)
    with evis.connect(wait_s=LIMIT_S) as run:
        states = run.topic("/state")
        first = run.take()
        run.act(wave(0, 2))
        assert run.due() == first + 20_000_000
        run.act(wave(1, 2))
        assert run.reset() == run.due() == first + 40_000_000
        run.act(wave(2, 2))
        run.act(wave(3, 2))
        begun = first + 3 * 20_000_000
        found = {}
        while begun + 20_000_000 not in found:
            state = states.read(LIMIT_S)
            assert state is not None, f"no state at {begun + 20_000_000} ns; there are {sorted(found)}"
            found[state.header.stamp_ns] = state
    graph.end()
    start = alone({}, 0, envs=2)[0]
    assert found[begun - 20_000_000].episodes.tolist() == [0, 0]
    assert found[begun].episodes.tolist() == [1, 1] and len(found[begun].t) == 1
    np.testing.assert_array_equal(found[begun].qpos, start)
    moved = alone({0: wave(3, 2)}, 20_000_000, envs=2)[20_000_000]
    assert found[begun + 20_000_000].t[0] == begun
    np.testing.assert_array_equal(found[begun + 20_000_000].qpos, moved)


def test_control_is_refused_where_it_cannot_be(launch: Callable[..., Launched]) -> None:
    """A scene without actuators, a controller in the launch file, a topic that nobody reads."""
    graph = launch(scene="spinning_disk")
    with evis.connect(wait_s=LIMIT_S) as run:
        with pytest.raises(ConnectionRefusedError, match="scene spinning_disk has no actuators"):
            run.act([0.0])
        with evis.connect(run.id) as again:
            assert again.id == run.id
    graph.end()
    with pytest.raises(ValueError, match="no graph is running"):
        evis.connect()


def test_a_controller_of_the_launch_file_is_not_ousted(launch: Callable[..., Launched], tmp_path: Path) -> None:
    (tmp_path / "graph0").mkdir()
    (tmp_path / "graph0" / "arm_controller.py").write_text(
        "import numpy as np\nfrom evis.runtime.node import Input, Node, Output\nfrom msgs.header import Header\n"
        "from msgs.world import Action\nclass Controller(Node):\n"
        "    INPUTS = {'state': Input('/state')}\n    OUTPUTS = {'action': Output('/action')}\n"
        "    def update(self, inputs):\n        self.publish('action', Action(Header(inputs['state'].header.stamp_ns), "
        "np.zeros((1, 6))))\n"
    )
    (tmp_path / "graph0").rename(tmp_path / "made")
    graph = launch(more=CONTROLLER)
    shutil.copy(tmp_path / "made" / "arm_controller.py", tmp_path / "graph0")
    with evis.connect(wait_s=LIMIT_S) as run:
        with pytest.raises(ConnectionRefusedError, match="controller, which the launch file declares, publishes it"):
            run.act(np.zeros(6))
        states = run.topic("/state")
        assert states.read(LIMIT_S).header.episode == 0
        run.reset()
        until(lambda: states.read(LIMIT_S).header.episode == 1)
    graph.end()


def test_of_several_graphs_the_newest_is_taken_and_named(launch: Callable[..., Launched]) -> None:
    first = launch()
    one = evis.connect(wait_s=LIMIT_S)
    second = launch()
    with pytest.warns(UserWarning, match=r"2 running graphs; this is the newest, .*evis.connect\(ID\) takes another"):
        other = until(lambda: (run := evis.connect()).id != one.id and run)
    assert isinstance(other, Run) and evis.connect(one.id).id == one.id
    assert one.take() >= 0 and other.take() >= 0
    for run in (one, other):
        run.close()
    for graph in (first, second):
        graph.end()


@pytest.mark.parametrize("words", [(), ("--compose",)])
def test_a_loop_is_closed_step_by_step(launch: Callable[..., Launched], words: tuple[str, ...]) -> None:
    """The second script of docs/control.md: every packet has its action, however the nodes are spread."""
    script = re.findall(r"^```py\n(.*?)^```", (ROOT / "docs" / "control.md").read_text(), re.M | re.S)[1]

    def closed() -> tuple[list[int], str]:
        """Stamps of the packets that had an action, and what the graph said."""
        graph = launch("robot_arm", "width:=32", "height:=24", "audit:=0", "--no-view", *words)
        stamps: list[int] = []

        def controls_from(packet: Any) -> np.ndarray:
            stamps.append(packet.header.stamp_ns)
            if len(stamps) > 20:
                raise StopAsyncIteration
            return np.full(6, 0.01 * len(stamps))

        until(lambda: list(Path(os.environ["XDG_RUNTIME_DIR"]).glob("evis/*/plan.json")))
        with pytest.raises(StopAsyncIteration):
            exec(compile(script, "control.md", "exec"), {"evis": evis, "controls_from": controls_from})
        return stamps, graph.end()

    # On a busy machine the graph may have gone before this process had its turn.
    tries = (closed() for _ in range(3))
    stamps, text = next((one for one in tries if one[0][0] == 0), ([1], ""))
    assert stamps[0] == 0 and len(set(stamps)) == 21, "who is there before the graph goes has it from the start"
    np.testing.assert_allclose(np.diff(stamps), 1e9 / 30, atol=1)
    assert "outside_actions=20" in text and "has left /action" in text and "the step at" not in text


def test_who_comes_amid_keyframes_made_at_once_has_each_before_its_step(launch: Callable[..., Launched]) -> None:
    graph = launch("robot_arm", "width:=96", "height:=72", "audit:=0", "--no-view", "--compose")
    with evis.connect(wait_s=LIMIT_S) as run:
        (plan,) = Path(os.environ["XDG_RUNTIME_DIR"]).glob("evis/*/plan.json")
        assert json.loads(plan.read_text())["single"] == "", "several at once"
        packets, states = run.topic("/cam0/events"), run.topic("/state", every=False)
        began = packets.read(LIMIT_S).header.stamp_ns
        # Longer than the queues of who does not read are.
        while states.read(LIMIT_S).header.stamp_ns < began + 10_000_000_000:
            pass
        run.take()
        for k in range(12):
            due = run.due()
            while packets.read(LIMIT_S).header.stamp_ns < due:
                pass
            run.act(np.full(6, 0.01 * k), stamp_ns=due)
    assert "outside_actions=12" in graph.end()


def test_the_script_of_the_page(launch: Callable[..., Launched], tmp_path: Path) -> None:
    """`evis launch robot_arm` here, the ten lines of docs/control.md there."""
    graph = launch("robot_arm", "width:=64", "height:=48", "audit:=0", "--no-view")
    script = re.findall(r"^```py\n(.*?)^```", (ROOT / "docs" / "control.md").read_text(), re.M | re.S)[0]
    assert len(script.splitlines()) <= 10
    (tmp_path / "script.py").write_text(script.replace("evis.connect()", f"evis.connect(wait_s={LIMIT_S})"))
    done = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, cwd=tmp_path, timeout=600)
    assert done.returncode == 0, done.stderr
    rows = re.findall(r"([\d.]+) s: (\d+) events; action from ([\d.]+) s", done.stdout)
    assert len(rows) > 90 and sum(int(events) for _, events, _ in rows) > 10_000
    stamps = [float(row[2]) for row in rows]
    np.testing.assert_allclose(np.diff(stamps), 1 / 30, atol=1.1e-3)
    text = graph.end()
    assert "controls /action" in text and "has left /action" in text and "resets=1" in text
