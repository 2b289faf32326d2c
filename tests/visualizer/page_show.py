"""Made-up graphs of a camera and of a simulator with labels, and pages on them that get messages one by one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from browser_panels import until
from synthetic_graph import make_node

from evis.runtime.plan import Edge, NodePlan, Plan, TopicPlan
from msgs.camera import CameraInfo, EventPacket, Labels
from msgs.header import Header, Message
from msgs.world import WorldState

WIDTH, HEIGHT = 173, 130
MS = 1_000_000
SHELVES = 90
"""Instances of the static world, most of them smaller than what is worth a box."""


def graph(directory: Path, **params: Any) -> Plan:
    """A camera node with all that a device may have; params are the node's."""
    plan = Plan("camera", "run-1", str(directory))
    plan.nodes["camera"] = NodePlan("camera", "nodes.camera.node:CameraNode", {"camera": "cam0", **params}, "camera")
    kinds = {"events": "EventPacket", "image": "Image", "imu": "Imu", "trigger": "Trigger", "info": "CameraInfo"}
    return with_topics(plan, "camera", {f"/cam0/{tail}": kind for tail, kind in kinds.items()})


def warehouse(directory: Path, labels: list[str]) -> Plan:
    """A simulator that was told to make labels."""
    plan = Plan("warehouse", "run-2", str(directory))
    for name in ("physics", "renderer", "event_sensor"):
        plan.nodes[name] = NodePlan(name, f"nodes.{name}.node:Node", {}, name)
    plan.nodes["labeler"] = NodePlan("labeler", "nodes.labeler.node:LabelerNode", {"labels": labels}, "labeler")
    with_topics(plan, "physics", {"/state": "WorldState"})
    with_topics(plan, "renderer", {"/cam0/keyframe": "Keyframe", "/cam0/info": "CameraInfo"})
    with_topics(plan, "event_sensor", {"/cam0/events": "EventPacket"})
    return with_topics(plan, "labeler", {"/cam0/labels": "Labels"})


def with_topics(plan: Plan, node: str, topics: dict[str, str]) -> Plan:
    plan.nodes.setdefault(
        "visualizer", NodePlan("visualizer", "nodes.visualizer.node:VisualizerNode", {}, "visualizer")
    )
    for name, kind in topics.items():
        tail = name.rpartition("/")[2]
        plan.topics[name] = TopicPlan(name, kind, node, tail, [Edge("visualizer", "in", "tap")], kind == "CameraInfo")
    return plan


class Show:
    """A page on a plan; `send` gives it messages, as often as the page needs them."""

    def __init__(self, browser: Any, plan: Plan, width: int, height: int) -> None:
        self.node = make_node(plan)
        self.problems: list[str] = []
        self.tab = browser.new_page()
        self.tab.set_viewport_size({"width": width, "height": height})
        self.tab.on("pageerror", lambda error: self.problems.append(str(error)))
        self.tab.goto(json.loads((Path(plan.directory) / "viewer.json").read_text())["url"])
        self.tab.locator("[data-panel=graph]").wait_for(state="attached")

    def send(self, messages: dict[str, Message]) -> None:
        """To the taps that are open."""
        self.node.idle()
        for topic, message in messages.items():
            self.node.runtime.send(topic, message)
        self.tab.wait_for_timeout(30)

    def play(self, messages: Callable[[int], dict[str, Message]], condition: Callable[[], Any], what: str) -> Any:
        """Messages of k = 1, 2, ... until something is so."""
        k = iter(range(1, 1 << 30))

        def again() -> Any:
            self.send(messages(next(k)))
            return condition()

        return until(self.tab, again, what)

    def panels(self) -> list[str]:
        return self.tab.locator("main > section").evaluate_all("all => all.map(p => p.dataset.panel)")

    def box(self, selector: str) -> dict[str, float]:
        """Place of the first element of a selector that can be seen on the screen."""
        return self.tab.locator(selector).first.bounding_box()

    def close(self) -> None:
        self.tab.close()
        self.node.close()
        assert self.problems == []


def events(k: int, episode: int = 0, turns: float = 0.0, n: int = 4000, period_ms: int = 33) -> EventPacket:
    """n events on a disk that makes `turns` in the packet's time; without turns: a line that moves slowly."""
    rng = np.random.default_rng(k)
    stamp, start = k * period_ms * MS, (k - 1) * period_ms * MS
    t = np.sort(rng.integers(start + 1, stamp + 1, n))
    if turns:
        # Twelve edges, bright behind dark; each event lies on the edge where it is at that time.
        edge, radius = rng.integers(0, 12, n), 50 * np.sqrt(rng.random(n))
        angle = 2 * np.pi * (edge / 12 + turns * (t - start) / (stamp - start))
        x, y, p = 86 + radius * np.cos(angle), 65 + radius * np.sin(angle), edge % 2
    else:
        x, y, p = 20 + 40 * t / 1e9 % 100, rng.integers(0, HEIGHT, n), rng.integers(0, 2, n)
    header = Header(stamp, k, clock="device:a", episode=episode)
    x, y, p = x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8)
    return EventPacket(header, np.array([0, n]), t, x, y, p, width=WIDTH, height=HEIGHT, t0_ns=start)


def camera_info(stamp_ns: int = 0) -> CameraInfo:
    return CameraInfo(Header(stamp_ns), np.eye(3), np.empty(0), width=WIDTH, height=HEIGHT)


def world() -> tuple[CameraInfo, np.ndarray, np.ndarray]:
    """Shelves of the static world, a pallet that stands, two forklifts that move: info, boxes and their ids."""
    shelves = [f"shelf_{k}" for k in range(SHELVES)]
    names = ["background", *shelves, "pallet_0", "forklift_0", "forklift_1", "barrel"]
    bodies = ["", *[""] * SHELVES, "pallet_0", "forklift_0", "forklift_1", "barrel"]
    semantic = np.array([0, *[1] * SHELVES, 2, 3, 3, 4], np.int32)
    info = camera_info()
    info.instances, info.instance_bodies, info.semantic = names, bodies, semantic
    info.classes = ["background", "shelf", "pallet", "forklift", "barrel"]
    own = [[2 * k % 150, 3 * k % 100, 2 * k % 150 + 20, 3 * k % 100 + 20] for k in range(SHELVES)]
    boxes = np.array([*own, [5, 80, 60, 120], [20, 20, 60, 60], [100, 30, 150, 90], [80, 5, 83, 8]], np.float32)
    return info, boxes, np.arange(1, len(boxes) + 1, dtype=np.int32)


def labelled(k: int) -> dict[str, Message]:
    """The world with its boxes, segmentation and flow."""
    info, boxes, ids = world()
    header = Header(k * 33 * MS, k)
    image = np.zeros((1, HEIGHT, WIDTH), np.int32)
    for (x0, y0, x1, y1), number in zip(boxes.astype(int), ids):
        image[0, y0 : y1 + 1, x0 : x1 + 1] = number
    image[0, -1, : len(ids)] = ids  # all can be seen
    labels = Labels(
        header, segmentation=image, flow=np.full((1, HEIGHT, WIDTH, 2), 3, np.float32), box=boxes,
        box_env=np.zeros(len(boxes), np.int32), box_id=ids,
    )  # fmt: skip
    names = ["pallet_0", "forklift_0", "forklift_1", "barrel"]
    pose = np.tile([0, 0, 0, 0, 0, 0, 1.0], (1, 2, 4, 1))
    pose[0, 1, 1:, 0] = 0.01 * k
    twist = np.zeros((1, 2, 4, 6))
    twist[0, :, 1:, 0] = 0.3
    t = np.array([(k - 1) * 33 * MS, k * 33 * MS])
    state = WorldState.dense(header, t, pose, twist, np.zeros(1, np.int32), names=names)
    return {"/cam0/info": info, "/cam0/labels": labels, "/state": state, "/cam0/events": events(k)}
