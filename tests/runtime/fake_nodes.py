"""Small nodes for tests of the runtime: a counter, a doubler that joins, a checker that writes what it saw."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from msgs.camera import Depth, Ids
from msgs.header import Header, Message
from msgs.world import Action, Reset, WorldState


class Counter(Node):
    """Publishes `count` depths and ids of size x size, 1 ms apart; waits for /action when that is wired."""

    PARAMS = {
        "count": Param(int, 10, "messages"),
        "size": Param(int, 8, "pixels"),
        "fail_at": Param(int, -1, "raise at this message"),
        "sleep": Param(float, 0.0, "per step", unit="s"),
    }
    INPUTS = {"action": Input("/action", delayed=True)}
    OUTPUTS = {"depth": Output("/cam0/depth"), "ids": Output("/cam0/ids"), "state": Output("/state")}
    SOURCE = True

    def setup(self) -> None:
        self.k = 0
        self.controls: list[float] = []

    def due(self) -> Mapping[str, int]:
        return {"action": (self.k - 1) * 1_000_000} if self.k else {}

    def step(self, inputs: Mapping[str, Message]) -> bool:
        if self.k == self.params["fail_at"]:
            raise ValueError(f"told to fail at message {self.k}")
        time.sleep(self.params["sleep"])
        if "action" in inputs:
            action = inputs["action"]
            assert isinstance(action, Action)
            self.controls.append(float(action.controls[0, 0]))
            assert self.controls[-1] == self.k - 1
        header, n = Header(self.k * 1_000_000), self.params["size"]
        if self.wants("depth"):
            depth = self.loan("depth", depth=((1, n, n), np.float32))["depth"]
            depth[:] = self.k
            self.publish("depth", Depth(Header(header.stamp_ns), depth))
        if self.wants("ids"):
            self.publish("ids", Ids(Header(header.stamp_ns), np.full((1, n, n), self.k, np.int32)))
        if self.wants("state"):
            zeros = np.zeros((1, 1, 0, 7)), np.zeros((1, 1, 0, 6))
            t, episodes = np.array([header.stamp_ns]), np.zeros(1, np.int32)
            self.publish("state", WorldState.dense(Header(header.stamp_ns), t, *zeros, episodes))
        self.k += 1
        return self.k < self.params["count"]


class Careless(Node):
    """Publishes what no node may, or forgets what a step must return."""

    PARAMS = {"how": Param(str, "", "which mistake")}
    OUTPUTS = {"depth": Output("/cam0/depth")}
    SOURCE = True

    def step(self, inputs: Mapping[str, Message]) -> bool:
        how, image = self.params["how"], np.zeros((1, 2, 2), np.float32)
        stamps = {"float stamp": 0.5, "long stamp": 1 << 63}
        message: Any = Depth(Header(stamps.get(how, 0)), image)  # type: ignore[arg-type]
        message.depth = {"list": image.tolist(), "scalar": np.float32(3)}.get(how, image)
        if how == "no header":
            message.header = None
        self.publish("deth" if how == "port" else "depth", None if how == "no message" else message)
        if how == "wants":
            self.wants("deth")
        return None if how == "no return" else False  # type: ignore[return-value]


class Adder(Node):
    """Joins depth and ids of one stamp; publishes their sum as ids of another camera. Keeps the previous depth."""

    INPUTS = {"depth": Input("/cam0/depth"), "ids": Input("/cam0/ids")}
    OUTPUTS = {"sum": Output("/cam1/ids")}
    PARAMS = {"sleep": Param(float, 0.0, "per update", unit="s")}

    def setup(self) -> None:
        self.previous: Depth | None = None

    def update(self, inputs: Mapping[str, Message]) -> None:
        depth, ids = inputs["depth"], inputs["ids"]
        assert isinstance(depth, Depth) and isinstance(ids, Ids)
        time.sleep(self.params["sleep"])
        before = -1.0 if self.previous is None else float(self.previous.depth.max())
        assert before == depth.depth.max() - 1, "a kept array was written over"
        total = (depth.depth + ids.ids).astype(np.int32)
        depth.keep()
        if self.previous is not None:
            self.previous.release()
        self.previous = depth
        self.publish("sum", Ids(Header(depth.header.stamp_ns, episode=depth.header.episode), total))


class Doubler(Node):
    """Publishes twice every depth."""

    PARAMS = {"sleep": Param(float, 0.0, "per update", unit="s")}
    INPUTS = {"depth": Input("/cam0/depth")}
    OUTPUTS = {"double": Output("/cam1/depth")}

    def update(self, inputs: Mapping[str, Message]) -> None:
        depth = inputs["depth"]
        assert isinstance(depth, Depth)
        time.sleep(self.params["sleep"])
        self.publish("double", Depth(Header(depth.header.stamp_ns), 2 * depth.depth))


class Controller(Node):
    """Closes the loop: for every state an action whose control is the state's number."""

    INPUTS = {"state": Input("/state")}
    OUTPUTS = {"action": Output("/action")}

    def update(self, inputs: Mapping[str, Message]) -> None:
        stamp = inputs["state"].header.stamp_ns
        self.publish("action", Action(Header(stamp), np.full((1, 1), stamp / 1e6)))


class Checker(Node):
    """Writes [stamp, seq, first value] of every message it gets to a JSON file at its end."""

    PARAMS = {"path": Param(str, "", "where to"), "sleep": Param(float, 0.0, "per message", unit="s")}
    INPUTS = {"messages": Input("*", join=False)}

    def setup(self) -> None:
        self.seen: dict[str, list[list[float]]] = {}

    def receive(self, port: str, message: Message) -> None:
        time.sleep(self.params["sleep"])
        array = next(iter(message.arrays().values()))
        value = float(np.asarray(array).flat[0]) if array.size else 0.0
        self.seen.setdefault(port, []).append([message.header.stamp_ns, message.header.seq, value])

    def close(self) -> None:
        if self.params["path"]:
            Path(self.params["path"]).write_text(json.dumps(self.seen))


class Machine(Node):
    """Goes on 1 ms a step, under actions from outside; remembers (stamp, controls or None) of each step it had."""

    INPUTS = {
        "action": Input("/action", join=False, delayed=True, outside=True),
        "reset": Input("/reset", join=False, outside=True),
    }
    SOURCE = True

    def setup(self) -> None:
        self.now_ns = 0
        self.had: list[tuple[int, list[float] | None]] = [(-1, None)]
        self.resets: list[tuple[list[int], list[int]]] = []

    def due(self) -> Mapping[str, int]:
        return {"action": self.now_ns}

    def offer(self, port: str) -> Mapping[str, object]:
        return {"names": ["spindle"]}

    def admit(self, port: str, message: Message) -> None:
        if isinstance(message, Action):
            if message.controls.shape != (1, 1):
                raise ValueError(f"controls are {list(message.controls.shape)}")
            if not np.isfinite(message.controls).all():
                raise ValueError(f"spindle is {message.controls[0, 0]}")

    def receive(self, port: str, message: Message) -> None:
        assert isinstance(message, Reset)
        self.resets.append((message.envs.tolist(), message.seeds.tolist()))

    def step(self, inputs: Mapping[str, Message]) -> bool:
        time.sleep(0.0005)
        action = inputs.get("action")
        self.had.append((self.now_ns, action.controls[0].tolist() if isinstance(action, Action) else None))
        self.now_ns += 1_000_000
        self.runtime.profile.node(self.name).stamp_ns = self.now_ns
        return True
