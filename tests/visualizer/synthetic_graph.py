"""A made-up graph for the visualizer: its plan, its messages, and the part of the executor that the node uses."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from evis.runtime.plan import Edge, LeftOut, NodePlan, Plan, TopicPlan
from msgs.camera import CameraInfo, Depth, EventPacket, Ids, Imu, Keyframe, Labels, Motion
from msgs.diagnostics import Diagnostics
from msgs.header import Header, Message
from msgs.world import Clock, WorldState
from nodes.visualizer.node import VisualizerNode

WIDTH, HEIGHT = 173, 130
RATE = 30


def make_plan(directory: Path, envs: int = 1) -> Plan:
    """A simulator with two cameras, one of them an event camera with all topics."""
    nodes = [
        ("physics", "simulation"), ("renderer", "simulation"), ("interpolator", "sensor"), ("event_sensor", "sensor"),
        ("labeler", "labeler"), ("davis", "davis"), ("recorder", "recorder"), ("visualizer", "visualizer"),
    ]  # fmt: skip
    topics = [
        ("/state", "WorldState", "physics", ["renderer", "interpolator"]),
        ("/cam0/info", "CameraInfo", "renderer", ["interpolator", "recorder"]),
        ("/cam0/keyframe", "Keyframe", "renderer", ["interpolator"]),
        ("/cam0/depth", "Depth", "renderer", ["interpolator"]),
        ("/cam0/motion", "Motion", "renderer", ["interpolator"]),
        ("/cam0/ids", "Ids", "renderer", []),
        ("/cam0/frames", "Frames", "interpolator", ["event_sensor"]),
        ("/cam0/events", "EventPacket", "event_sensor", ["recorder"]),
        ("/cam0/labels", "Labels", "labeler", []),
        ("/davis/events", "EventPacket", "davis", ["recorder"]),
        ("/davis/imu", "Imu", "davis", []),
    ]
    plan = Plan("spinning_disk", "run-1", str(directory), seed=7, duration_s=2.0, args={"envs": envs, "threshold": 0.2})
    for name, process in nodes:
        target = "nodes.visualizer.node:VisualizerNode" if name == "visualizer" else f"nodes.{name}.node:Node"
        plan.nodes[name] = NodePlan(name, target, {}, process, dormant=name == "labeler")
    for name, kind, node, readers in topics:
        edges = [Edge(reader, "in", "lockstep") for reader in readers]
        plan.topics[name] = TopicPlan(name, kind, node, name.rpartition("/")[2], edges, latched=kind == "CameraInfo")
    plan.left_out = [
        LeftOut("MuJoCo", "the scene has only prescribed motion"),
        LeftOut("/cam0/normal", "nobody reads it"),
    ]
    return plan


class FakeTap:
    """What `open_tap` gives."""

    def __init__(self, runtime: FakeRuntime, topic: str, callback: Callable[[Message], None]) -> None:
        self.runtime, self.topic, self.callback = runtime, topic, callback

    def close(self) -> None:
        self.runtime.taps.pop(self.topic)


class FakeRuntime:
    """Taps, requests and diagnostics of the executor, recorded."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.failure = ""
        self.taps: dict[str, FakeTap] = {}
        self.requested: list[str] = []
        self.said: list[tuple[str, str]] = []
        self.told: list[str] = []
        self.hidden: list[str] = []
        self.counted: Counter[str] = Counter()
        self.refuse: str = ""

    def open_tap(self, node: Any, topic: str, callback: Callable[[Message], None]) -> FakeTap:
        if topic == self.refuse:
            raise ValueError(f"{node.name}: nobody publishes {topic}")
        assert topic not in self.taps
        self.taps[topic] = FakeTap(self, topic, callback)
        return self.taps[topic]

    def request(self, topic: str) -> None:
        self.requested.append(topic)

    def diagnose(self, node: Any, level: str, text: str) -> None:
        self.said.append((level, text))

    def tell(self, node: Any, text: str) -> None:
        self.told.append(text)

    def hide(self, secret: str) -> None:
        self.hidden.append(secret)

    def count(self, node: Any, name: str, amount: float) -> None:
        self.counted[name] += amount  # type: ignore[assignment]

    def send(self, topic: str, message: Message) -> None:
        message.check()
        if topic in self.taps:
            self.taps[topic].callback(message)


def make_node(plan: Plan, **params: Any) -> VisualizerNode:
    """A visualizer set up on a fake runtime, on any free port."""
    node = VisualizerNode("visualizer", {"port": 0, **params})
    node.runtime = FakeRuntime(plan)  # type: ignore[assignment]
    node.setup()
    return node


def events_at(k: int, n: int = 6000, envs: int = 1, bad: bool = False) -> EventPacket:
    """Two rings of events around a point that moves with k."""
    rng = np.random.default_rng(k)
    angle = rng.uniform(0, 2 * np.pi, n * envs)
    on = rng.random(n * envs) < 0.5
    radius = np.where(on, 40, 34) + rng.normal(0, 1.2, n * envs)
    centre = 86 + 25 * np.sin(k / 9), 65 + 15 * np.cos(k / 7)
    x = np.clip(centre[0] + radius * np.cos(angle), 0, WIDTH - 1).astype(np.uint16)
    y = np.clip(centre[1] + radius * np.sin(angle), 0, HEIGHT - 1).astype(np.uint16)
    if bad:
        x[:3] = 5000
    stamp, before = _stamp(k), _stamp(k - 1)
    t = np.linspace(before + 1, stamp, n * envs).astype(np.int64)
    offsets = np.arange(envs + 1, dtype=np.int64) * n
    return EventPacket(
        Header(stamp, k), offsets, t, x, y, on.astype(np.uint8), width=WIDTH, height=HEIGHT, t0_ns=before
    )


def _stamp(k: int) -> int:
    return round(k * 1e9 / RATE)


def _scene(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Distance from the moving centre [px] and its direction."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    dx, dy = x - 86 - 25 * np.sin(k / 9), y - 65 - 15 * np.cos(k / 7)
    return np.hypot(dx, dy), np.arctan2(dy, dx)


def images_at(k: int, envs: int = 1) -> dict[str, Message]:
    """Keyframe (HDR), depth with sky and a NaN, motion and ids of a striped disk."""
    r, angle = _scene(k)
    disk = r < 38
    stripes = 0.5 + 0.45 * np.sign(np.sin(8 * (angle + k / 12)))
    radiance = np.where(disk, 20 * stripes + 0.2, 0.6 + 0.004 * np.arange(WIDTH, dtype=np.float32))
    rgb = (radiance[..., None] * np.array([1.0, 0.86, 0.7])).astype(np.float32)
    rgb[3, 3] = np.nan
    depth = np.where(disk, 1.0 + r / 100, np.where(r < 60, 2.5, np.inf)).astype(np.float32)
    depth[0, 0] = np.nan
    motion = np.where(disk[..., None], np.stack([-np.sin(angle), np.cos(angle)], -1) * r[..., None] / 12, 0)
    ids = np.where(disk, 1, np.where(r < 60, 2, 0)).astype(np.int32)
    header, tile = Header(_stamp(k), k), lambda a: np.repeat(a[None], envs, 0)
    return {
        "/cam0/keyframe": Keyframe(header, np.zeros(envs, np.int32), tile(rgb)),
        "/cam0/depth": Depth(header, tile(depth)),
        "/cam0/motion": Motion(header, tile(motion.astype(np.float32))),
        "/cam0/ids": Ids(header, tile(ids)),
    }


def labels_at(k: int) -> Labels:
    """Segmentation, flow, one box and one pose."""
    ids = images_at(k)["/cam0/ids"].ids  # type: ignore[attr-defined]
    rows, columns = np.nonzero(ids[0] == 1)
    box = np.array([[columns.min(), rows.min(), columns.max(), rows.max()]], np.float32)
    flow = np.full((1, HEIGHT, WIDTH, 2), np.nan, np.float32)
    flow[ids == 1] = (30, -20)
    return Labels(
        Header(_stamp(k), k), flow=flow, segmentation=ids, box=box, box_env=np.zeros(1, np.int32),
        box_id=np.ones(1, np.int32), pose=np.array([[[0, 0, 1.5, 0, 0, 0, 1]]], np.float64),
        velocity=np.array([[[3, 4, 0, 0, 0, 2]]], np.float64), names=["disk"],
    )  # fmt: skip


def info() -> CameraInfo:
    """The camera of the other messages."""
    k = np.array([[150.0, 0, 86], [0, 150, 65], [0, 0, 1]])
    return CameraInfo(
        Header(0), k, np.empty(0), width=WIDTH, height=HEIGHT, instances=["background", "disk", "wall"],
        keyframe_rate=30, upsampling=8, sensor={"threshold": 0.2},
    )  # fmt: skip


def others_at(k: int) -> dict[str, Message]:
    """State, inertial samples, clock and diagnostics."""
    header = Header(_stamp(k), k)
    t = np.linspace(_stamp(k - 1), _stamp(k), 8).astype(np.int64)
    wave = np.sin(np.outer(t / 1e9, [2, 3, 5]))
    values = {
        "updates": k, "ms_per_update": 3.21, "busy_s": 0.0032 * k, "waits_s": 0.001 * k, "events": 6000 * k, "queue": 1,
        "published": {"/cam0/events": k}, "counters": {"clipped": 2, "lost": 0},
    }  # fmt: skip
    pose = np.array([[[[0, 0, 1.5, 0, 0, 0, 1.0]]]])
    return {
        "/state": WorldState.dense(header, t[-1:], pose, np.zeros((1, 1, 1, 6)), np.zeros(1, np.int32), names=["disk"]),
        "/davis/imu": Imu(header, t, wave * 9.81, wave * 2),
        "/clock": Clock(header, real_time_factor=0.83),
        "/diagnostics": Diagnostics(Header(time.time_ns(), k, "wall"), node="event_sensor", values=values),
    }


class Player:
    """Plays the graph in a thread of its own, as the executor would, until closed."""

    def __init__(self, node: VisualizerNode, rate: float = RATE, envs: int = 1) -> None:
        self.node, self.period, self.envs = node, 1 / rate, envs
        self.error: BaseException | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._main, daemon=True)
        self._thread.start()

    def _main(self) -> None:
        try:
            self._play()
        except BaseException as error:
            self.error = error

    def _play(self) -> None:
        runtime: Any = self.node.runtime
        had_info = False
        k = 1
        while not self._stop.wait(self.period):
            self.node.idle()
            if "/cam0/info" not in runtime.taps:
                had_info = False
            elif not had_info:
                had_info = True
                runtime.send("/cam0/info", info())
            messages = {**images_at(k, self.envs), **others_at(k), "/cam0/labels": labels_at(k)}
            messages["/cam0/events"] = messages["/davis/events"] = events_at(k, envs=self.envs)
            for topic, message in messages.items():
                runtime.send(topic, message)
            k += 1

    def close(self) -> None:
        self._stop.set()
        self._thread.join(60)
        assert not self._thread.is_alive()
        self.node.finish()
        self.node.close()
        if self.error:
            raise self.error
