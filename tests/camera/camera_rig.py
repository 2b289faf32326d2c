"""A runtime that keeps what a camera node publishes, a wall clock under the test's control, small recordings."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from evis.events import Events, open_writer
from nodes.camera.node import CameraNode

DATA = Path(os.environ.get("EVIS_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))


class Runtime:
    """Collects messages by port, counters and warnings."""

    def __init__(self, *wanted: str) -> None:
        self.wanted = wanted or ("events", "info")
        self.messages: dict[str, list[Any]] = {}
        self.counters: Counter[str] = Counter()
        self.warnings: list[str] = []

    def wants(self, node: Any, port: str) -> bool:
        return port in self.wanted

    def loan(self, node: Any, port: str, arrays: Any) -> dict[str, np.ndarray]:
        return {name: np.full(shape, 77, dtype) for name, (shape, dtype) in arrays.items()}

    def publish(self, node: Any, port: str, message: Any) -> None:
        message.check()
        self.messages.setdefault(port, []).append(message)

    def count(self, node: Any, name: str, amount: float) -> None:
        self.counters[name] += amount

    def diagnose(self, node: Any, level: str, text: str) -> None:
        self.warnings.append(text)


class WallClock:
    """Time passes only in sleep, and when the test says so."""

    def __init__(self) -> None:
        self.ns = 1_000_000_000_000
        self.slept = 0.0

    def now(self) -> int:
        return self.ns

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0
        self.slept += seconds
        self.ns += round(seconds * 1e9)


def play(runtime: Runtime, max_steps: int = 100_000, **params: Any) -> Runtime:
    """Run a camera node to its end, as the executor does."""
    node = CameraNode("camera", params)
    node.runtime = runtime  # type: ignore[assignment]
    try:
        node.setup()
        for _ in range(max_steps):
            if not node.step({}):
                return runtime
        raise AssertionError("the node does not end")
    finally:
        node.close()


def joined(packets: list[Any]) -> Events:
    """All packets' events in order."""
    return Events(*(np.concatenate([getattr(p, n) for p in packets]) for n in "txyp"))


def write(path: Path, t: Any, encoding: str = "") -> Path:
    """A small recording with the given times [ns]."""
    n = len(t)
    with open_writer(path, 64, 48, encoding) as writer:
        writer.write(Events.of(t, np.arange(n) % 64, np.arange(n) % 48, np.arange(n) % 2))
    return path
