"""Defines the nodes of `evis bench camera`: a camera node flooded by an emulated USB device, and a reader of its
events.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.events import Events
from evis.events.codecs.encoder import encoder_for
from evis.runtime.node import Input, Node
from msgs.camera import EventPacket
from msgs.header import Message
from nodes.camera.node import CameraNode
from nodes.camera.usb.driver import UsbDriver

TURN_US = 5 * 4096
"""Device time of one turn of the prepared bytes: whole TIME_HIGH periods, so that only those words change."""
GROUP = 4
SETTLED_S = 0.5
"""The first packets map shared memory; latency counts from here [s]."""
WIDTH, HEIGHT = 1280, 720


def prepared(rate: float) -> np.ndarray:
    """Makes EVT3 words (uint16) of one turn at `rate` bytes/s of device time: groups of four neighbours in a row."""
    rng = np.random.default_rng(5)
    groups = round(rate * TURN_US / 1e6 / 11.2)  # bytes per group, refined below
    for _ in range(3):
        t = np.repeat(np.sort(rng.integers(1, TURN_US, groups)), GROUP) * 1000
        x = np.repeat(rng.integers(0, WIDTH // 32, groups) * 32, GROUP) + np.tile(np.arange(GROUP) * 7, groups)
        y = np.repeat(rng.integers(0, HEIGHT, groups), GROUP)
        words = np.frombuffer(
            encoder_for("evt3").encode(Events.of(t, x, y, np.repeat(rng.integers(0, 2, groups), GROUP))), "<u2"
        )
        groups = round(groups * rate * TURN_US / 1e6 / words.nbytes)
    return words.copy()


def turns(words: np.ndarray) -> Iterator[np.ndarray]:
    """Repeats the prepared bytes without end, with TIME_HIGH words that count on."""
    at = np.flatnonzero(words >> 12 == 8)
    high = words[at].astype(np.int64) & 0xFFF
    while True:
        words[at] = 0x8000 | high & 0xFFF
        yield words.view(np.uint8)
        high += TURN_US >> 12


class FloodCameraNode(CameraNode):
    """Runs the camera node on an emulated EVK4 that waits for nobody, and writes what it measured at its end."""

    driver: UsbDriver
    PARAMS: ClassVar[dict[str, Param]] = {
        **CameraNode.PARAMS,
        "rate": Param(float, 200e6, "bytes per second that the sensor sends", "B/s", 1e3, 1e10),
        "seconds": Param(float, 3.0, "how long", "s", 0.1, 600),
        "out": Param(str, "", "file for the result"),
    }

    def _open(self) -> None:
        from nodes.camera.emulated.bus import driver_on
        from nodes.camera.emulated.flood_feed import FloodFeed
        from nodes.camera.usb.models import MODELS

        p = self.params
        self._words = prepared(p["rate"])
        self.feed = FloodFeed(turns(self._words.copy()), p["rate"], seconds=p["seconds"])
        self.driver = driver_on(MODELS["evk4"], self.feed)
        self.driver.wait_when_full = False
        self.driver.open()
        kind = self.driver.settings_type()
        self.driver.configure(kind.of({"packet_ms": p["packet_ms"]}))
        self.driver.allocate = self.columns
        self.meter = Meter(self.driver.emulated.bulk_in)
        self.driver.emulated.bulk_in = self.meter
        self._status_at = time.monotonic() + 1e9
        self.about = self.driver.info()
        self._latency: list[int] = []
        self._began = 0.0

    def step(self, inputs: Mapping[str, Message]) -> bool:
        if not self._began:
            self.driver.start()
            self._began, self._cpu = time.monotonic(), time.process_time()
        return super().step(inputs)

    def publish(self, port: str, message: Message) -> None:
        super().publish(port, message)
        if port == "events" and time.monotonic() - self._began > SETTLED_S:
            self._latency.append(time.monotonic_ns() - self.driver.read_at_ns)

    def finish(self) -> None:
        super().finish()
        wall, cpu = time.monotonic() - self._began, time.process_time() - self._cpu
        counters = self.driver.counters()
        stream = self.driver.stream_bytes
        result = {
            "wall_s": wall,
            "cpu_s": cpu,
            "emulator_cpu_s": self.meter.cpu_s,
            "offered": self.feed.offered,
            "lost_in_camera": self.feed.lost,
            "lost_in_driver": counters.get("bytes_lost", 0),
            "received": stream,
            "latency_ms": [float(v) / 1e6 for v in np.percentile(self._latency or [0], (50, 99, 100))],
            "pause_ms": self.driver.longest_pause_ns / 1e6,
            "joined": counters.get("intervals_joined", 0),
        }
        Path(self.params["out"]).write_text(json.dumps(result))


class Meter:
    """Wraps a bulk read and measures the CPU time of the emulated device, which a real one would not take."""

    def __init__(self, read: Callable[[int, Any, float], int]) -> None:
        self._read = read
        self.cpu_s = 0.0

    def __call__(self, endpoint: int, buffer: Any, timeout_s: float) -> int:
        before = time.thread_time()
        try:
            return self._read(endpoint, buffer, timeout_s)
        finally:
            self.cpu_s += time.thread_time() - before


class SinkNode(Node):
    """Reads the events as a consumer would, and counts them."""

    PARAMS: ClassVar[Mapping[str, Param]] = {"camera": Param(str, "cam0", "camera to read")}
    INPUTS: ClassVar[Mapping[str, Input]] = {"events": Input("/{camera}/events")}

    def update(self, inputs: Mapping[str, Message]) -> None:
        packet = inputs["events"]
        assert isinstance(packet, EventPacket) and packet.t is not None
        self.count("events", len(packet.t))
        self.count("packets_marked", int(packet.lost > 0))
