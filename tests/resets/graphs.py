"""Graphs in this process that are stepped and reset from outside."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from evis.launch.planner import Options, plan_target
from evis.runtime.executor import Executor
from evis.runtime.plan import COMPOSED
from evis.supervisor.run_directory import RunDirectory
from msgs.camera import EventPacket
from msgs.header import Header, Message
from msgs.world import Reset, WorldState

SIZE = {"width": 40, "height": 30}
COLUMNS = ("t", "x", "y", "p")


class Graph:
    """Runs a scene with all nodes in this process; keeps copies of the messages of `kept` and the last states' rows."""

    def __init__(
        self, folder: Path, scene: str, *, duration: float = 20.0, kept: tuple[type[Message], ...] = (), **given: Any
    ) -> None:
        given = {"device": "cpu", "keyframe_rate": 30.0, "upsampling": 4, "audit": 0, "batch": 1, **SIZE, **given}
        folder.mkdir(parents=True, exist_ok=True)
        self.bag = folder / "run.mcap"
        plan = plan_target(scene, given, Options(duration, str(self.bag), view=False, grouping="compose"))
        for node in plan.nodes.values():
            if node.process.startswith("share"):
                node.process = COMPOSED  # of several devices too
        self._directory = RunDirectory()
        plan.run_id, plan.directory = self._directory.run_id, str(self._directory.path)
        self._executor = Executor(plan, COMPOSED)
        self.rate: float = plan.nodes["physics"].params["keyframe_rate"]
        self.packets: list[EventPacket] = []
        self.states: list[WorldState] = []
        self.messages: list[Message] = []
        publish = self._executor.publish

        def heard(node: Any, port: str, message: Any) -> None:
            part = node.name.startswith("share")
            if isinstance(message, EventPacket) and not part:
                message.check()
                self.packets.append(_copied(message))
            elif isinstance(message, WorldState):
                self.states.append(_copied(message))
            if isinstance(message, kept):
                self.messages.append(_copied(message))
            publish(node, port, message)

        self._executor.publish = heard  # type: ignore[method-assign]
        with contextlib.redirect_stderr(io.StringIO()):
            self._executor.setup()
        self._physics = self._executor._hosts["physics"]

    def step(self, count: int) -> Graph:
        """Keyframe after keyframe through the whole graph."""
        for _ in range(count):
            assert self._executor._scheduler.call(self._physics)
        return self

    def restart(self, envs: list[int], seeds: list[int] | None = None) -> None:
        """At the present stamp, as who steps the graph does."""
        self._physics.node.restart(envs, seeds or [])  # type: ignore[attr-defined]

    def ask(self, envs: list[int], seeds: list[int] | None = None) -> None:
        """At the next stamp, as a message on /reset does."""
        reset = Reset(Header(0), np.array(envs, np.int32), np.array(seeds or [], np.int64))
        self._physics.node.receive("reset", reset)

    def count(self, node: str, name: str) -> float:
        """A counter of a node."""
        return self._executor.profile.node(node).counters[name]

    def end(self) -> None:
        """As at the end of a run."""
        self._executor.stop()
        with contextlib.redirect_stderr(io.StringIO()):
            self._executor.run()
        self._executor.close()
        self._directory.close()

    def events(self, env: int, first: int = 0) -> dict[str, np.ndarray]:
        """All events of an environment from packet `first` on."""
        found = {}
        for name in COLUMNS:
            parts = [getattr(p, name)[p.env_offsets[env] : p.env_offsets[env + 1]] for p in self.packets[first:]]
            found[name] = np.concatenate(parts) if parts else np.zeros(0)
        return found


def _copied(message: Any) -> Any:
    arrays = {n: np.array(a if isinstance(a, np.ndarray) else a.numpy()) for n, a in message.arrays().items()}
    copy = object.__new__(type(message))
    copy.__dict__.update(message.__dict__ | arrays)
    return copy


def assert_same_events(made: dict[str, np.ndarray], truth: dict[str, np.ndarray], origin_ns: int = 0) -> None:
    """Byte for byte, in time since the origin."""
    assert len(made["t"]) == len(truth["t"])
    for name in COLUMNS:
        mine = made[name] - origin_ns if name == "t" else made[name]
        assert np.array_equal(mine, truth[name]), name
