"""A graph in one process without an executor: physics, renderer, interpolator, sensor and labeler, called in turn."""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from evis.bag.environments import split
from evis.runtime.node import Node
from msgs.header import Message
from nodes.event_sensor.node import EventSensorNode
from nodes.interpolator.node import InterpolatorNode
from nodes.labeler.node import LabelerNode
from nodes.physics.node import PhysicsNode
from nodes.renderer.node import RendererNode

MOVES = """
args: {vary: {default: 1, min: 0, max: 1, help: how much}}
cameras: {cam0: {position: [0, -1.2, 0.3], look_at: [0, 0, 0], fov: 40 deg}}
bodies:
  ball:
    position: [0, 0, {from: 0, to: 0.1}]
    motion:
      - {kind: sinusoid, amplitude: [{from: 0.1, to: "${0.1 + 0.2 * vary}"}, 0, 0], frequency: {from: 3, to: 6}}
      - {kind: spin, axis: {normal: {mean: [0, 0, 0], sigma: 1}}, rate: {from: 2, to: 9}}
    shapes: [{shape: box, size: [0.1, 0.2, 0.15], material: paint}]
  lid: {parent: ball, position: [0, 0, 0.1], shapes: [{shape: sphere, radius: 0.04, material: grey}]}
materials:
  paint: {texture: {kind: checker, size: 32, cells: 4, low: 0.1, high: 0.9}}
  grey: {albedo: 0.4}
world: [{shape: plane, size: [3, 3], position: [0, 0.6, 0], rotation: {axis: [1, 0, 0], angle: 90 deg}, material: grey}]
lights: {lamp: {kind: point, position: [0.5, -1, 1], intensity: 6}}
environment: 0.2
"""
"""Motion and start are drawn."""
SENSOR = """
sensor:
  {threshold: {from: 0.08, to: 0.15}, leak_rate: {from: 1, to: 20}, threshold_mismatch: 0.01}
"""
"""A sensor whose faults are drawn."""
LOOKS = {
    "fov: 40 deg": "fov: {from: 38 deg, to: 45 deg}",
    "size: [0.1, 0.2, 0.15]": "size: {from: [0.1, 0.1, 0.1], to: [0.2, 0.2, 0.2]}",
    "material: paint": "material: {choose: [paint, grey]}",
    "cells: 4": "cells: {from: 2, to: 8}",
    "albedo: 0.4": "albedo: {from: [0.2, 0.2, 0.2], to: [0.9, 0.9, 0.9]}",
    "position: [0.5, -1, 1]": "position: {from: [0.5, -1.5, 0.5], to: [1, -1, 1.5]}",
    "intensity: 6": "intensity: {from: 3, to: 10, log: true}",
    "environment: 0.2": "environment: {from: 0.1, to: 0.3}",
}
"""What else may be drawn of it."""


def looks() -> str:
    """The scene of MOVES with everything drawn."""
    text = MOVES
    for plain, drawn in LOOKS.items():
        assert plain in text
        text = text.replace(plain, drawn)
    return text


class Bus:
    """Stands for the executor: keeps what is published."""

    def __init__(self, unwanted: tuple[str, ...] = ()) -> None:
        self.plan = SimpleNamespace(sensor_beside=lambda *_: {})
        self.unwanted = unwanted
        self.sent: dict[str, list[Message]] = {}
        self.said: list[str] = []

    def wants(self, node: Node, port: str, array: str = "") -> bool:
        return port not in self.unwanted and array != "radiance"

    def loan(self, node: Node, port: str, arrays: Any) -> dict[str, np.ndarray]:
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def lending(self, node: Node, port: str) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def publish(self, node: Node, port: str, message: Message) -> None:
        message.check()
        self.sent.setdefault(port, []).append(message)

    def count(self, node: Node, name: str, amount: float) -> None:
        """Counts nothing."""

    def diagnose(self, node: Node, level: str, text: str) -> None:
        self.said.append(text)


class Graph:
    """Runs a scene for some keyframes; `messages` are what each output gave."""

    def __init__(
        self, scene: Path, seed: int, envs: int, method: str = "rigid", keyframes: int = 4, **more: Any
    ) -> None:
        size = {"width": 40, "height": 30}
        world = {"scene": str(scene), "seed": seed, "envs": envs, **size, **more}
        rate = 30.0 if method != "none" else 120.0
        self.bus = Bus(("signal", "samples") if method != "none" else ("signal", "frames"))
        self.physics = PhysicsNode("physics", {**world, "keyframe_rate": rate, "joints": True})
        self.renderer = RendererNode("renderer", world)
        self.interpolator = InterpolatorNode("interpolator", {**world, "method": method, "upsampling": 4})
        source = "keyframe" if method == "none" else "frames"
        own = {"scene": str(scene), **more} | ({} if "sensor:" in scene.read_text() else {"threshold": 0.1})
        self.sensor = EventSensorNode("event_sensor", {"seed": seed, "source": source, **own})
        self.labeler = LabelerNode("labeler", {"labels": "flow,segmentation,boxes"})
        nodes: tuple[Node, ...] = (self.physics, self.renderer, self.sensor, self.labeler)
        for node in (*nodes, *((self.interpolator,) if method != "none" else ())):
            node.runtime = self.bus  # type: ignore[assignment]
            node.setup()
        self.messages = self.bus.sent
        self.labeler.receive("info", self.messages["info"][0])
        for _ in range(keyframes):
            self._step(method)

    def _step(self, method: str) -> None:
        self.physics.step({})
        self.renderer.update({"state": self._last("state")})
        images = {port: self._last(port) for port in ("keyframe", "depth", "motion")}
        if method == "none":
            self.sensor.update({"keyframe": images["keyframe"]})
        else:
            self.interpolator.update({**images, "state": self._last("state")})
            self.sensor.update({"frames": self._last("frames")})
        self.labeler.update({port: self._last(port) for port in ("state", "depth", "ids")})

    def _last(self, port: str) -> Any:
        return self.messages[port][-1]

    def of(self, env: int, envs: int) -> dict[str, list[dict[str, bytes]]]:
        """The arrays of every message as bytes, of one environment: what a run of it alone would have given."""
        found = {}
        for port in ("keyframe", "depth", "motion", "ids", "normal", "frames", "events", "labels"):
            parts = [split(m, envs)[env][0] for m in self.messages.get(port, [])]
            found[port] = [{n: np.ascontiguousarray(a).tobytes() for n, a in part.arrays().items()} for part in parts]
        return found
