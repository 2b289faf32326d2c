"""Nodes that publish and take Warp arrays: a painter, a watcher that keeps some, and a reader of numpy arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from msgs.camera import Depth, Motion
from msgs.header import Header, Message

DEVICE = Param(str, "cpu", "Warp device")


class Painter(Node):
    """Publishes `count` depths and motions in Warp arrays: all k at the k-th stamp, motion as vectors."""

    PARAMS = {
        "count": Param(int, 20, "messages"),
        "size": Param(int, 8, "pixels"),
        "device": DEVICE,
        "loans": Param(str, "", "file of the types of loans that are where depths are read, and not always Warp's"),
    }
    OUTPUTS = {"depth": Output("/cam0/depth"), "motion": Output("/cam0/motion")}
    SOURCE = True

    def setup(self) -> None:
        self.k = 0
        self.loans: list[str] = []

    def step(self, inputs: Mapping[str, Message]) -> bool:
        device, shape = wp.get_device(self.params["device"]), (1, self.params["size"], self.params["size"])
        loan = self.loan_for_readers if self.params["loans"] else self.loan_on
        depth = loan("depth", device, depth=(shape, wp.float32))["depth"]
        self.loans.append(type(depth).__name__)
        (depth.fill if isinstance(depth, np.ndarray) else depth.fill_)(float(self.k))
        self.publish("depth", Depth(Header(self.k * 1_000_000), depth))
        if self.wants("motion"):
            motion = self.loan_on("motion", device, motion=(shape, wp.vec2))["motion"]
            motion.fill_(wp.vec2(float(self.k), -float(self.k)))
            self.publish("motion", Motion(Header(self.k * 1_000_000), motion))
        self.k += 1
        return self.k < self.params["count"]

    def close(self) -> None:
        if self.params["loans"]:
            Path(self.params["loans"]).write_text(json.dumps(self.loans))


class Watcher(Node):
    """Joins both, takes Warp arrays, keeps the last three depths, and writes down what it saw."""

    PARAMS = {"path": Param(str, "", "where to"), "device": DEVICE}
    INPUTS = {
        "depth": Input("/cam0/depth", on_device=True),
        "motion": Input("/cam0/motion", on_device=True),
    }

    def setup(self) -> None:
        self.kept: list[tuple[int, Depth]] = []
        self.seen: list[list[float | bool]] = []

    def update(self, inputs: Mapping[str, Message]) -> None:
        depth, motion = inputs["depth"], inputs["motion"]
        assert isinstance(depth, Depth) and isinstance(motion, Motion)
        assert depth.header.seq == motion.header.seq
        for seq, old in self.kept:
            assert (_numpy(old.depth) == seq).all(), "a kept array was written over"
        values = _numpy(motion.motion)
        assert values.shape[-1] == 2
        here = not isinstance(depth.depth, np.ndarray)
        self.seen.append([here, float(_numpy(depth.depth).max()), float(values[0, 0, 0, 0]), float(values.min())])
        depth.keep()
        self.kept.append((depth.header.seq, depth))
        if len(self.kept) > 3:
            self.kept.pop(0)[1].release()

    def close(self) -> None:
        for _, message in self.kept:
            message.release()
        Path(self.params["path"]).write_text(json.dumps(self.seen))


class Reader(Node):
    """Knows nothing of devices; writes down [type, value] of every depth."""

    PARAMS = {"path": Param(str, "", "where to")}
    INPUTS = {"depth": Input("/cam0/depth")}

    def setup(self) -> None:
        self.seen: list[list[str | float]] = []

    def update(self, inputs: Mapping[str, Message]) -> None:
        depth = inputs["depth"]
        assert isinstance(depth, Depth)
        self.seen.append([type(depth.depth).__name__, float(depth.depth.min())])

    def close(self) -> None:
        Path(self.params["path"]).write_text(json.dumps(self.seen))


class Glancer(Node):
    """Reads the arrays of every third depth alone; writes down [type, rows, number] of all."""

    PARAMS = {"path": Param(str, "", "where to")}
    INPUTS = {"depth": Input("/cam0/depth", join=False)}

    def setup(self) -> None:
        self.seen: list[list[str | int]] = []

    @classmethod
    def arrays_hz(cls, params: Mapping[str, Any], port: str) -> float | None:
        return 1000 / 3 if port == "depth" else None

    def receive(self, port: str, message: Message) -> None:
        assert isinstance(message, Depth) and message.header.seq == len(self.seen)
        if isinstance(message.depth, np.ndarray):
            assert (message.depth == message.header.seq).all()
        self.seen.append([type(message.depth).__name__, message.depth.shape[0], message.header.seq])

    def close(self) -> None:
        Path(self.params["path"]).write_text(json.dumps(self.seen))


def _numpy(array: np.ndarray | wp.array) -> np.ndarray:
    return array if isinstance(array, np.ndarray) else array.numpy()
