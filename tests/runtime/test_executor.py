"""The executor: the same messages however the nodes are spread, loops closed by stamp, errors that name the node."""

from __future__ import annotations

import json
import re
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import zmq

from evis.bus import Subscriber, endpoints_for
from evis.runtime.executor import Executor
from evis.runtime.hosting.node_call import NodeFailed
from evis.runtime.hosting.wiring import TAP_HZ
from evis.runtime.plan import Edge, NodePlan, Plan, TopicPlan
from msgs.camera import Depth

sys.path.insert(0, str(Path(__file__).parent))
from plan_runs import run_in_threads

LIMIT_S = 60.0
"""For all that is waited for."""
SPREADS = {
    "composed": ["p", "p", "p"],
    "source alone": ["a", "b", "b"],
    "split": ["a", "b", "c"],
    "there and back": ["a", "b", "a"],
}


def make_plan(directory: Path, processes: list[str], **params: dict[str, Any]) -> Plan:
    """counter -> (depth, ids) -> adder -> sum -> checker, which reads depth too."""
    names = ("counter", "adder", "checker")
    where = dict(zip(names, processes))
    classes = {"counter": "Counter", "adder": "Adder", "checker": "Checker"}
    inputs = {
        "counter": {},
        "adder": {"depth": ["/cam0/depth"], "ids": ["/cam0/ids"]},
        "checker": {"messages": ["/cam0/depth", "/cam1/ids"]},
    }
    outputs = {"counter": {"depth": "/cam0/depth", "ids": "/cam0/ids"}, "adder": {"sum": "/cam1/ids"}, "checker": {}}
    params.setdefault("checker", {})["path"] = str(directory / "seen.json")
    plan = Plan("test", "run", str(directory))
    for name in names:
        plan.nodes[name] = NodePlan(
            name, f"fake_nodes:{classes[name]}", params.get(name, {}), where[name], inputs[name], outputs[name]
        )
    plan.topics = {
        "/cam0/depth": TopicPlan(
            "/cam0/depth", "Depth", "counter", "depth", [Edge("adder", "depth"), Edge("checker", "messages")]
        ),
        "/cam0/ids": TopicPlan("/cam0/ids", "Ids", "counter", "ids", [Edge("adder", "ids")]),
        "/cam1/ids": TopicPlan("/cam1/ids", "Ids", "adder", "sum", [Edge("checker", "messages")]),
    }
    return plan


@pytest.mark.parametrize(("every", "slow"), [(True, 0.0), (True, 0.03), (False, 0.0)])
def test_who_wants_every_message_of_a_dormant_node_misses_none_uncounted(
    tmp_path: Path, every: bool, slow: float
) -> None:
    """It gets all that the counter has made, or counts the rest as lost; a viewer makes the node read as a viewer."""
    count = 200
    plan = make_plan(tmp_path, ["a", "b", "c"], counter={"count": count, "sleep": 0.005})
    del plan.nodes["adder"], plan.nodes["checker"], plan.topics["/cam0/ids"], plan.topics["/cam1/ids"]
    plan.nodes["counter"].outputs = {"depth": "/cam0/depth"}
    plan.nodes["doubler"] = NodePlan(
        "doubler", "fake_nodes:Doubler", {"sleep": slow}, "b", {"depth": ["/cam0/depth"]}, {"double": "/cam1/depth"},
        dormant=True,
    )  # fmt: skip
    plan.topics["/cam0/depth"].edges = [Edge("doubler", "depth", "tap")]
    plan.topics["/cam1/depth"] = TopicPlan("/cam1/depth", "Depth", "doubler", "double")
    context = zmq.Context()
    reader = Subscriber(
        context, "/cam1/depth", "program", "tap", endpoints_for(str(tmp_path), "/cam1/depth"), message_type=Depth,
        tap=True, every=every,
    )  # fmt: skip
    executors = [Executor(plan, process) for process in "ab"]
    for executor in executors:
        executor.setup()
    threads = [threading.Thread(target=executor.run, daemon=True) for executor in executors]
    reader.start()
    threads[1].start()
    counted, doubled = (e._hosts[n].publishers[t] for e, n, t in zip(executors, plan.nodes, plan.topics))
    # the doubler hears of its reader, and asks; the counter's thread serves its publisher later
    end = time.monotonic() + LIMIT_S
    while not (doubled.wanted() and counted.wanted() and counted.tapped_by_eager() == every):
        assert time.monotonic() < end, "the reader is not heard of"
        counted.pump()
        time.sleep(0.005)
    began = time.monotonic()
    threads[0].start()
    values: list[int] = []
    while threads[1].is_alive():
        assert time.monotonic() < began + LIMIT_S, "the doubler does not end"
        if isinstance(message := reader.receive(100), Depth):
            values.append(int(message.depth.flat[0]) // 2)
        elif not threads[0].is_alive():
            executors[1].stop()
    took_s = time.monotonic() - began
    threads[0].join(LIMIT_S)
    assert not threads[0].is_alive()
    assert values == sorted(set(values)) and len(values) > 10
    missing = values[-1] - values[0] + 1 - len(values)
    if every:
        assert reader.lost == missing and (missing > 0 if slow else len(values) > 0.5 * count)
    else:
        assert len(values) <= 2 + TAP_HZ * took_s
    reader.close()
    context.destroy(linger=0)
    for executor in executors:
        executor.close()


def seen(directory: Path) -> dict[str, list[list[float]]]:
    return json.loads((directory / "seen.json").read_text())


@pytest.mark.parametrize("size", [8, 300])  # inline, and through shared memory
@pytest.mark.parametrize("spread", SPREADS)
def test_every_message_arrives_once_and_in_order(tmp_path: Path, spread: str, size: int) -> None:
    count = 60
    plan = make_plan(tmp_path, SPREADS[spread], counter={"count": count, "size": size})
    assert run_in_threads(plan) == {}
    expected = {
        "/cam0/depth": [[k * 1e6, k, k] for k in range(count)],
        "/cam1/ids": [[k * 1e6, k, 2 * k] for k in range(count)],
    }
    assert seen(tmp_path) == expected


@pytest.mark.parametrize("slow", ["adder", "checker"])
def test_a_slow_consumer_holds_the_others_back_and_loses_nothing(tmp_path: Path, slow: str) -> None:
    plan = make_plan(tmp_path, ["a", "b", "c"], counter={"count": 30, "size": 300}, **{slow: {"sleep": 0.005}})
    assert run_in_threads(plan) == {}
    assert [v for _, _, v in seen(tmp_path)["/cam1/ids"]] == [2 * k for k in range(30)]


@pytest.mark.parametrize("processes", [["p", "p"], ["a", "b"]])
def test_an_action_reaches_the_step_that_starts_at_its_stamp(tmp_path: Path, processes: list[str]) -> None:
    """The counter asserts the control of every step; the loop must neither run ahead nor hang."""
    plan = Plan("loop", "run", str(tmp_path))
    plan.nodes = {
        "counter": NodePlan(
            "counter", "fake_nodes:Counter", {"count": 40}, processes[0], {"action": ["/action"]}, {"state": "/state"}
        ),
        "controller": NodePlan(
            "controller", "fake_nodes:Controller", {}, processes[1], {"state": ["/state"]}, {"action": "/action"}
        ),
    }
    plan.topics = {
        "/state": TopicPlan("/state", "WorldState", "counter", "state", [Edge("controller", "state")]),
        "/action": TopicPlan("/action", "Action", "controller", "action", [Edge("counter", "action", "delayed")]),
    }
    assert run_in_threads(plan) == {}


@pytest.mark.parametrize("spread", ["composed", "split"])
def test_a_failing_node_is_named_and_what_came_before_is_kept(tmp_path: Path, spread: str) -> None:
    plan = make_plan(tmp_path, SPREADS[spread], counter={"count": 10, "fail_at": 5})
    errors = run_in_threads(plan)
    (failure,) = [e for e in errors.values() if isinstance(e, NodeFailed)]
    assert failure.node == "counter" and "told to fail at message 5" in str(failure)
    assert all(v == 2 * k for k, (_, _, v) in enumerate(seen(tmp_path).get("/cam1/ids", [])))


def test_realtime_follows_the_stamps(tmp_path: Path) -> None:
    """Not a speed test: 40 steps of 1 ms cannot take less than 39 ms when paced."""
    plan = make_plan(tmp_path, SPREADS["composed"], counter={"count": 40})
    plan.mode = "realtime"
    executor = Executor(plan, "p")
    executor.setup()
    executor.wait_connected(LIMIT_S)
    start = time.monotonic()
    executor.run()
    assert time.monotonic() - start >= 0.039
    assert "late_ms_max" in executor.summary()["counter"]["counters"]
    executor.close()


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ("port", "no output is called 'deth'; Careless.OUTPUTS declares depth"),
        ("wants", "no output is called 'deth'; Careless.OUTPUTS declares depth"),
        ("float stamp", "the stamp 0.5; it must be int64"),
        ("long stamp", "the stamp 9223372036854775808; it must be int64"),
        ("no header", "the stamp None; it must be int64"),
        ("no message", "declared Depth and published NoneType"),
        ("list", "Depth.depth is a value of type list, and must be an array"),
        ("scalar", "Depth.depth is a value of type float32, and must be an array"),
        ("no return", "step returned None"),
    ],
)
@pytest.mark.parametrize("closed", [False, True])
def test_what_a_node_must_not_publish_is_told_by_name(how: str, told: str, closed: bool, tmp_path: Path) -> None:
    plan = Plan("test", "run", "" if closed else str(tmp_path))
    plan.nodes["a"] = NodePlan("a", "fake_nodes:Careless", {"how": how}, "p", {}, {"depth": "/cam0/depth"})
    plan.topics = {"/cam0/depth": TopicPlan("/cam0/depth", "Depth", "a", "depth", [])}
    executor = Executor(plan, "p")
    try:
        executor.setup()
        with pytest.raises(NodeFailed, match=f"^a: .*{re.escape(told)}"):
            executor.run()
    finally:
        executor.close()
