"""A node's inputs from outside: who may control it, what a step gets from there, and how control goes back."""

from __future__ import annotations

import math
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from evis.bus.links import Link, connect
from evis.client.requests import Requests
from evis.runtime.executor import Executor
from evis.runtime.outside import ANY_STAMP, controlled_input
from evis.runtime.plan import NodePlan, Plan
from msgs.codec import encode
from msgs.header import Header
from msgs.world import Action, Reset

sys.path.insert(0, str(Path(__file__).parent))
LIMIT_S = 60.0


def until(condition: Callable[[], Any]) -> Any:
    """Wait for something true, and give it."""
    end = time.monotonic() + LIMIT_S
    while not (value := condition()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.005)
    return value


class Graph:
    """A machine in a process of its own, run by a thread of this one; `lines`: what it says."""

    def __init__(self, folder: Path, mode: str) -> None:
        outside = {"action": "/action", "reset": "/reset"}
        self.plan = Plan("lathe", "run", str(folder), mode=mode)
        self.plan.nodes["machine"] = NodePlan("machine", "fake_nodes:Machine", {}, "p", outside=outside)
        self.executor = Executor(self.plan, "p")
        self.lines: list[tuple[str, str]] = []
        said = self.executor._telemetry.say

        def say(host: Any, name: str, level: str, text: str) -> None:
            self.lines.append((level, text))
            said(host, name, level, text)

        self.executor._telemetry.say = say  # type: ignore[method-assign]
        self.node: Any = self.executor._hosts["machine"].node
        self.failure: BaseException | None = None
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.executor.setup()
            self.executor.run()
        except BaseException as error:
            self.failure = error
        finally:
            self.executor.close()

    def program(self) -> Requests:
        """A program that speaks to it."""
        until(lambda: (Path(self.plan.directory) / "machine.door").exists())
        return Requests(self.plan, "machine")

    def counters(self) -> dict[str, Any]:
        return dict(self.executor.profile.node("machine").counters)

    def end(self) -> None:
        self.executor.stop()
        self.thread.join(LIMIT_S)
        assert not self.thread.is_alive() and self.failure is None, self.failure


@pytest.fixture
def graph() -> Iterator[Callable[[str], Graph]]:
    graphs: list[Graph] = []
    folder = Path(tempfile.mkdtemp(prefix="ev", dir="/tmp"))

    def start(mode: str) -> Graph:
        graphs.append(Graph(folder, mode))
        return graphs[-1]

    yield start
    for one in graphs:
        one.end()
    shutil.rmtree(folder)


def action(*values: float, stamp: int = ANY_STAMP) -> Action:
    return Action(Header(stamp), np.array([values], np.float64))


def take(program: Requests, lockstep: bool | None = None, patience_s: float = LIMIT_S) -> dict[str, Any]:
    return program.attach("/action", lockstep, patience_s)


def due(program: Requests) -> int:
    """The stamp of the step that waits."""
    until(lambda: program.catch_up(0.05) or program.due_ns is not None)
    assert program.due_ns is not None
    return program.due_ns


def test_in_lockstep_each_step_has_its_own_action(graph: Callable[[str], Graph]) -> None:
    run = graph("lockstep")
    program = run.program()
    welcome = take(program)
    assert welcome["lockstep"] and welcome["offer"] == {"names": ["spindle"]}
    first = due(program)
    for k in range(20):
        assert due(program) == first + 1_000_000 * k
        assert len(run.node.had) and run.node.now_ns == first + 1_000_000 * k, "it waits at that step"
        program.send("/action", action(k, stamp=program.due_ns or 0))
    due(program)
    given = {stamp: values for stamp, values in run.node.had if stamp >= first}
    assert given == {first + 1_000_000 * k: [float(k)] for k in range(20)}
    program.leave()
    program.close()
    until(lambda: run.node.now_ns > first + 40_000_000)  # and on it goes, without
    assert {values is None for stamp, values in run.node.had if stamp > first + 20_000_000} == {True}
    assert run.lines[0][0] == "info" and f"controls /action from {first / 1e9:.6g} s on" in run.lines[0][1]
    assert "has left /action" in run.lines[1][1] and "its last action holds" in run.lines[1][1]
    assert run.counters()["outside_actions"] == 20


@pytest.mark.parametrize("mode", ["realtime", "live"])
def test_free_running_the_latest_holds(graph: Callable[[str], Graph], mode: str) -> None:
    run = graph(mode)
    program = run.program()
    assert take(program)["lockstep"] is False
    before = until(lambda: run.node.now_ns)
    until(lambda: run.node.now_ns > before)  # it waits for nobody
    program.send("/action", action(7))
    until(lambda: [7.0] in [values for _, values in run.node.had])
    assert sum(values is not None for _, values in run.node.had) == 1, "a node keeps an action by itself"
    with pytest.raises(ConnectionRefusedError, match="waits for nobody; attach with lockstep=False"):
        take(program, lockstep=True)
    program.close()


def test_lockstep_can_be_left_out(graph: Callable[[str], Graph]) -> None:
    run = graph("lockstep")
    program = run.program()
    assert take(program, lockstep=False)["lockstep"] is False
    before = run.node.now_ns
    until(lambda: run.node.now_ns > before)
    program.send("/action", action(3))
    program.close()  # what it gave last is done all the same
    until(lambda: [3.0] in [values for _, values in run.node.had])


def test_two_controllers(graph: Callable[[str], Graph]) -> None:
    run = graph("lockstep")
    first, second = run.program(), run.program()
    take(first)
    with pytest.raises(ConnectionRefusedError, match=r"outside\) controls /action already; it must leave first"):
        take(second)
    with pytest.raises(ValueError, match="it has to attach first"):
        second.send("/action", action(1))
    first.leave()
    until(lambda: len(run.lines) == 2)
    take(second)
    second.send("/action", action(1, stamp=due(second)))
    with pytest.raises(ValueError, match="it has to attach first"):
        first.send("/action", action(1))
    for program in (first, second):
        program.close()


@pytest.mark.parametrize("again", ["left", "lost"])
def test_who_takes_control_again_is_told_of_the_present_step(graph: Callable[[str], Graph], again: str) -> None:
    """And not of the one that waited as it left or lost control, which lay unread in its socket."""
    run = graph("lockstep")
    program = run.program()
    take(program, patience_s=LIMIT_S if again == "left" else 0.5)
    stamp = due(program)
    program.send("/action", action(1.0, stamp=stamp))
    until(lambda: run.node.now_ns > stamp and run.executor._hosts["machine"].outside.controlled["action"]._due)
    if again == "left":
        program.leave()
    until(lambda: run.node.now_ns > stamp + 10_000_000)
    welcome = take(program)
    assert program.lost == "" and (program.due_ns is None or program.due_ns >= welcome["stamp_ns"])
    assert due(program) >= welcome["stamp_ns"] > stamp + 10_000_000
    assert due(program) == run.node.now_ns
    program.send("/action", action(2.0, stamp=due(program)))
    program.close()


def test_who_dies_hands_control_back(graph: Callable[[str], Graph]) -> None:
    run = graph("lockstep")
    program = run.program()
    take(program)
    stamp = due(program)
    program.close()  # as the system closes the socket of a process that is killed
    until(lambda: run.node.now_ns > stamp)
    assert ("warning", True) in [(level, "is gone without a word" in text) for level, text in run.lines]


def test_who_leaves_and_is_gone_has_left(graph: Callable[[str], Graph]) -> None:
    """Its last action counts, although nobody reads the answers any more: of twenty programs, for it is a race."""
    run = graph("lockstep")
    for n in range(20):
        program = run.program()
        take(program)
        given = action(n, stamp=due(program))
        program._link.send([msgpack.packb({"op": "message", "topic": "/action"}), *encode(given)])
        program.leave()
        program.close()
        until(lambda n=n: sum("has left /action" in text for _, text in run.lines) == n + 1 or run.failure)
    assert not any("gone without a word" in text for _, text in run.lines)
    assert run.counters()["outside_actions"] == 20
    until(lambda: [19.0] in [values for _, values in run.node.had])


def test_who_says_nothing_is_named_and_loses_control(
    graph: Callable[[str], Graph], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controlled_input, "SAY_S", 0.05)
    run = graph("lockstep")
    program = run.program()
    take(program, patience_s=0.3)
    stamp = due(program)
    until(lambda: run.node.now_ns > stamp)
    waits = [text for _, text in run.lines if "waits for its action from" in text]
    assert len(waits) == 1 and f"the step at {stamp / 1e9:.6g} s" in waits[0]
    assert any("gave no action for 0.3 s and lost /action" in text for _, text in run.lines)
    until(lambda: program.catch_up(0.05) or program.lost)
    assert "gave no action for 0.3 s" in program.lost
    with pytest.raises(ConnectionError, match="lost /action"):
        program.send("/action", action(1))
    take(program)  # it may have it again
    program.send("/action", action(1, stamp=due(program)))
    program.close()


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (action(np.nan), "spindle is nan"),
        (action(1, 2), r"\[1, 2\]"),
        (action(1, stamp=0), "an action for 0 s is late: the next step starts at"),
        (action(1, stamp=10**15), "too early: the next step starts at"),
    ],
)
def test_a_wrong_action_is_refused_and_counted(graph: Callable[[str], Graph], wrong: Action, why: str) -> None:
    run = graph("lockstep")
    program = run.program()
    until(lambda: getattr(run.node, "now_ns", 0) > 0)  # an action for 0 s is late from here on
    take(program)
    stamp = due(program)
    for _ in range(3):
        with pytest.raises(ValueError, match=why):
            program.send("/action", wrong)
    assert run.node.now_ns == stamp, "the step still waits"
    program.send("/action", action(1, stamp=stamp))
    assert due(program) == stamp + 1_000_000
    assert run.counters()["refused_actions"] == 3 and run.counters()["outside_actions"] == 1
    assert sum("refused from" in text for _, text in run.lines) == 1
    program.close()


def test_what_is_not_controlled_is_just_given(graph: Callable[[str], Graph]) -> None:
    run = graph("lockstep")
    program = run.program()
    program.send("/reset", Reset(Header(0), np.array([3], np.int32), np.array([5], np.int64)))
    until(lambda: run.node.resets == [([3], [5])])
    with pytest.raises(ConnectionRefusedError, match="/reset is nothing to control"):
        program.attach("/reset", None, 1.0)
    with pytest.raises(ValueError, match="machine takes no '/state' from outside"):
        program.send("/state", action(1))
    with pytest.raises(ValueError, match="the sender publishes Action, this side expects Reset"):
        program.send("/reset", action(1))
    program.close()


def test_who_speaks_another_language_is_dropped(graph: Callable[[str], Graph]) -> None:
    run = graph("lockstep")
    run.program().close()
    link: Link = connect(Path(run.plan.directory) / "machine.door")
    deep = msgpack.packb("who") + b"\x91" * 1000 + b"\xc0"
    for body in (
        b"\xc1", msgpack.packb([1]), msgpack.packb({"topic": "/action"}), b"\x82\xa2op" + deep[4:] + deep,
        msgpack.packb({"op": "message", "topic": []}), msgpack.packb({"op": "attach", "topic": {}}),
    ):  # fmt: skip
        link.send([body], 1.0)
        with pytest.raises(ConnectionError):
            link.receive(LIMIT_S)
        link.close()
        link = connect(Path(run.plan.directory) / "machine.door")
    link.send([msgpack.packb({"op": "dance", "topic": "/action"})], 1.0)
    answer = link.receive(LIMIT_S)
    assert answer is not None and b"no request is called 'dance'" in answer[0]
    attach = msgpack.packb({"op": "attach", "topic": "/action"})[1:]
    for field, value in (
        ("patience_s", msgpack.packb([])), ("patience_s", msgpack.packb(math.nan)), ("patience_s", msgpack.packb("x")),
        ("who", deep[4:]),
    ):  # fmt: skip
        link.send([b"\x83" + attach + msgpack.packb(field) + value], 1.0)
        answer = link.receive(LIMIT_S)
        assert answer is not None and f"{field} must be".encode() in answer[0]
    link.close()
    assert run.failure is None


def test_the_end_of_the_graph_is_told(graph: Callable[[str], Graph]) -> None:
    run = graph("lockstep")
    program = run.program()
    take(program)
    due(program)
    run.executor.stop()
    with pytest.raises(ConnectionError, match="lathe has ended"):
        while True:
            program.catch_up(0.1)
    assert program.lost == "the graph has ended"
    program.close()
