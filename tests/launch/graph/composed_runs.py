"""Runs of one process, and what they publish."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from evis.launch.planner import Options, plan_target
from evis.runtime.executor import Executor
from evis.runtime.node import Node
from evis.runtime.plan import COMPOSED, Plan
from msgs.header import Header, Message

SMALL = {"width": 48, "height": 36, "audit": 0}
LENGTH_S = 0.3
Record = tuple[str, Header, dict[str, bytes]]


def composed(
    scene: str, grouping: str = "compose", explain: bool = False, length_s: float = LENGTH_S, **given: Any
) -> Plan:
    options = Options(duration_s=length_s, view=False, grouping=grouping, explain=explain)
    return plan_target(scene, {**SMALL, **given}, options)


def published(
    scene: str, at_state: Callable[[Executor, int], None] | None = None, directory: Path | None = None, **given: Any
) -> list[Record]:
    """What a composed run publishes on the topics of its camera, in the order of each topic."""
    return run_of(scene, at_state, directory, **given)[0]


def executor_of(plan: Plan, directory: Path | None = None) -> Executor:
    """Makes the one process of a plan, with what it has awake; where no directory is given for its sockets, programs
    outside have none."""
    plan.nodes = {name: node for name, node in plan.nodes.items() if node.process == COMPOSED and not node.dormant}
    plan.topics = {name: topic for name, topic in plan.topics.items() if topic.node in plan.nodes}
    plan.directory = "" if directory is None else str(directory)
    if directory is None:
        for node in plan.nodes.values():
            node.outside = {}
    return Executor(plan, COMPOSED)


def run_of(
    scene: str,
    at_state: Callable[[Executor, int], None] | None = None,
    directory: Path | None = None,
    **given: Any,
) -> tuple[list[Record], dict[str, dict[str, int]]]:
    """What a composed run publishes on the topics of its camera, in the order of each topic; what its nodes count."""
    executor = executor_of(composed(scene, **given), directory)
    found: list[Record] = []
    states = 0

    def note(node: Node, port: str, message: Message) -> None:
        nonlocal states
        if port == "state":
            states += 1
            if at_state is not None:
                at_state(executor, states - 1)
        elif port not in ("error", "info"):
            on_host = {n: a if isinstance(a, np.ndarray) else a.numpy() for n, a in message.arrays().items()}
            arrays = {name: array.tobytes() for name, array in on_host.items()}
            found.append((port, message.header, arrays))

    one, many = executor.publish, executor.publish_all

    def publish(node: Node, port: str, message: Message) -> None:
        one(node, port, message)
        note(node, port, message)

    def publish_all(node: Node, port: str, messages: list[Message]) -> None:
        many(node, port, messages)
        for message in messages:
            note(node, port, message)

    executor.publish, executor.publish_all = publish, publish_all  # type: ignore[method-assign, assignment]
    try:
        executor.setup()
        executor.run()
    finally:
        executor.close()
    counts = {name: dict(node["counters"]) for name, node in executor.summary().items()}
    return sorted(found, key=lambda record: (record[0], record[1].seq)), counts


RECORDED_APART = """
args:
  batch: {type: int, default: 1, help: keyframes at once}
nodes:
  physics: {type: physics, process: here, params: {scene: balls, width: 48, height: 36, duration: "${duration}"}}
  renderer:
    {type: renderer, process: here, params: {scene: balls, width: 48, height: 36, samples_apart: true, frame_rate: 240,
      batch: "${batch}"}}
  interpolator:
    {type: interpolator, process: here, params: {scene: balls, width: 48, height: 36, batch: "${batch}"}}
  event_sensor: {type: event_sensor, process: here, keep: [events], params: {source: frames, scene: balls}}
  imu: {type: imu, keep: [imu]}
  recorder: {type: recorder, params: {path: "${record}", topics: "${record_topics}"}}
"""
"""All that makes keyframes in one process; what only takes of it in others."""


def on_gpu(scene: str, *, grouping: str = "default", **given: Any) -> Plan:
    record = given.pop("record", None)
    options = Options(duration_s=LENGTH_S, view=True, grouping=grouping, record=record)
    return plan_target(scene, {"width": 48, "height": 36, "device": "cuda", **given}, options)
