"""How many keyframes are made at once: what memory, caches and the length of a run allow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from composed_runs import SMALL, composed, executor_of, on_gpu

from evis.launch.planner import WINDOW_AT_ONCE, WINDOW_ON_CPU, Options, plan_target
from evis.runtime.executor import Executor
from nodes.renderer.at_once import MOST, MOST_ON_CPU, at_once, keyframes_of, refined_at_once


def test_on_a_cpu_small_pictures_come_several_at_once() -> None:
    """But not those by paths, of which one too many costs more than all else; who asks gets what is asked for."""
    assert at_once("renderer", 0, "cpu", 1, 96 * 72, 8) == 8
    assert at_once("renderer", 0, "cpu", 1, 346 * 260, 8) == 4
    assert at_once("renderer", 0, "cpu", 1, 1280 * 720, 8) == 1
    assert at_once("renderer", 0, "cpu", 1, 96 * 72, 8, paths=True) == 1
    assert at_once("renderer", 3, "cpu", 1, 96 * 72, 8, paths=True) == 3
    assert refined_at_once(8, 0, "cpu", 96 * 72 * 255) == 4
    assert refined_at_once(8, 0, "cpu", 346 * 260 * 255) == 1
    assert refined_at_once(4, 4, "cpu", 346 * 260 * 255) == 4


def test_all_that_are_made_at_once_may_be_under_way() -> None:
    """And two more, so that a recorder in another process does not hold up the batch after them."""
    assert (WINDOW_AT_ONCE, WINDOW_ON_CPU) == (MOST + 2, MOST_ON_CPU + 2)
    assert on_gpu("warehouse").window == WINDOW_AT_ONCE and composed("warehouse").window == WINDOW_ON_CPU


@pytest.mark.gpu
def test_a_short_run_takes_fewer_on_a_gpu() -> None:
    """It would be filled up in the last batch, and its buffers grow in the first."""
    count = lambda run_s, rate: at_once("renderer", 0, "cuda", 1, 1000, 8, keyframes=keyframes_of(run_s, rate))
    assert [count(*run) for run in ((1, 30), (12, 30), (16, 30), (4, 125), (None, 30))] == [8, 16, 32, 32, 32]


@pytest.mark.gpu
def test_a_recorded_run_takes_fewer_on_a_gpu() -> None:
    """Its recorder would wait for the events of a batch, and then be waited for."""
    assert [at_once("renderer", 0, "cuda", 1, 1000, 8, recorded=recorded) for recorded in (False, True)] == [32, 8]


def test_nodes_are_told_of_a_recorder(tmp_path: Path) -> None:
    recorded = plan_target("spinning_disk", SMALL, Options(view=False, record=str(tmp_path / "a.mcap")))
    assert recorded.recorded and not composed("spinning_disk").recorded
    node = recorded.nodes["event_sensor"]
    plan = replace(recorded, directory="", topics={}, nodes={"event_sensor": replace(node, inputs={}, outputs={})})
    executor = Executor(plan, node.process)
    try:
        executor._introduce(host := executor._hosts["event_sensor"])
        assert host.node.recorded
    finally:
        executor.close()


def test_a_graph_of_small_pictures_takes_several_on_a_cpu() -> None:
    taken: list[int] = []
    executor = executor_of(composed("spinning_disk", time_tolerance=0))
    try:
        executor.setup()
        interpolator = executor.node("interpolator")
        update = interpolator.update_all
        interpolator.update_all = lambda inputs: taken.append(len(inputs)) or update(inputs)
        executor.run()
    finally:
        executor.close()
    assert max(taken) == 8


def test_environments_are_a_batch_already() -> None:
    assert at_once("renderer", 0, "cpu", 8, 1000, 8) == 1
    assert at_once("renderer", 5, "cpu", 1, 1000, 8) == 5
    with pytest.raises(ValueError, match="batch:=4 with envs:=8: environments are a batch already"):
        at_once("renderer", 4, "cpu", 8, 1000, 8)
