"""Measures a run from within: a physics node that notes when each keyframe begins, and records the device's work."""

from __future__ import annotations

import functools
import statistics
import time
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import warp as wp

from bench.roofline.counting import Counting
from bench.throughput.recording import Recording
from evis.config.params import Param
from msgs.header import Message
from nodes.physics import node as physics

WAITS = ("wp_cuda_stream_synchronize", "wp_cuda_context_synchronize", "wp_cuda_event_synchronize")
"""Calls of Warp's library in which the host waits for the device."""
WARM_GAPS = 3
"""Gaps before anything is measured, at least: kernels are loaded, graphs recorded, buffers grown."""
COUNTED_GAPS = 2
"""Gaps in which the bytes and operations of kernels are counted."""
MOST_RECORDED = 128
"""Gaps of which everything that the device does is recorded: several times as many as go through it at once, for the
first of them find it idle."""


class Mark(NamedTuple):
    """Marks where a window begins: at which gap, at which time of time.perf_counter() [s], 0 before the first one, and
    how long the host had waited for the device by then [s]."""

    gap: int
    at: float
    waited_s: float


class PhysicsNode(physics.PhysicsNode):
    """Publishes states as the physics node does, and measures the run that it drives.

    A window of gaps lasts `window_s`; after the last of `windows` the device's work is recorded for as many gaps as
    last about a window, unless `records` is off, and with `ends` the run ends there. What was measured is the result
    `meter` of the run.
    """

    PARAMS: ClassVar[Mapping[str, Param]] = {
        **physics.PhysicsNode.PARAMS,
        "windows": Param(int, 5, "windows that are measured", "", 1),
        "window_s": Param(float, 0.3, "length of a window", "s", 0.0),
        "warm_s": Param(float, 0.5, "length of what is not measured at first", "s", 0.0),
        "ends": Param(bool, True, "the run ends when all is measured"),
        "measured": Param(str, "cpu", "device whose work is recorded"),
        "records": Param(bool, True, "its work is recorded after the last window"),
        "counts": Param(bool, False, "instead of times, bytes and operations of kernels are measured"),
    }

    def __init__(self, name: str, params: Mapping[str, Any]) -> None:
        """Begins to count before any kernel is loaded."""
        super().__init__(name, params)
        self.measured = wp.get_device(self.params["measured"])
        self.counting = Counting(self.measured) if self.params["counts"] else None

    def setup(self) -> None:
        """Prepares the node and the measurement."""
        super().setup()
        self.waited_s = 0.0
        self.windows: list[dict[str, float]] = []
        self.recording: Recording | None = None
        self._started_at = 0.0
        self._mark = Mark(0, 0.0, 0.0)
        self._begun: tuple[int, dict[str, float]] = (0, {})
        if self.measured.is_cuda:
            core: Any = wp._src.context.runtime.core  # type: ignore[attr-defined]
            for name in WAITS:
                setattr(core, name, self._timed(getattr(core, name)))

    def _timed(self, wait: Any) -> Any:
        """Adds the time of a call to that which the host has waited."""

        @functools.wraps(wait)
        def timed(*args: Any) -> Any:
            began = time.perf_counter()
            try:
                return wait(*args)
            finally:
                self.waited_s += time.perf_counter() - began

        return timed

    def step(self, inputs: Mapping[str, Message]) -> bool:
        """Measures the gap that has ended and publishes the state at the next stamp."""
        over = self._look(self.k) if self.counting is None else self._count(self.counting, self.k)
        return super().step(inputs) and not (over and self.params["ends"])

    def _look(self, k: int) -> bool:
        """Ends a window that is over at the beginning of gap k; gives whether everything is measured."""
        now, p = time.perf_counter(), self.params
        if k == 0:
            self._started_at = now
        if self.windows and len(self.windows) == p["windows"]:
            return not p["records"] or self._record(k, now)
        if not self._mark.at:
            if k >= WARM_GAPS and now - self._started_at >= p["warm_s"]:
                self._mark = Mark(k, time.perf_counter(), self.waited_s)
                self._begun = k, self._busy()
            return False
        first, began, waited = self._mark
        if k > first and now - began >= p["window_s"]:
            gaps = k - first
            self.windows.append({
                "rtf": gaps / p["keyframe_rate"] / (now - began),
                "wall_ms": 1e3 * (now - began) / gaps,
                "host_ms": 1e3 * (now - began - self.waited_s + waited) / gaps,
            })  # fmt: skip
            self._say(k)
            self._mark = Mark(k, time.perf_counter(), self.waited_s)
        return False

    def _count(self, counting: Counting, k: int) -> bool:
        """Switches counting on for COUNTED_GAPS gaps or more, since gaps may come in batches; gives whether they are
        over."""
        if not counting.on and k >= WARM_GAPS:
            counting.on, self._mark = True, Mark(k, 0.0, 0.0)
        over = counting.on and k - self._mark.gap >= COUNTED_GAPS
        if over:
            counting.on = False
            self.runtime.result(self, "meter", {"counted": counting.kernels})
        return over

    def _busy(self) -> dict[str, float]:
        """Gives the time [s] that each node of the process has spent so far, and the bus between them."""
        return {name: node.busy_s for name, node in self.runtime.profile.nodes.items()}  # type: ignore[attr-defined]

    def _say(self, k: int) -> None:
        """Publishes the windows so far, memory, and the time per gap of each node as the result `meter`."""
        first, before = self._begun
        nodes = {name: 1e3 * (s - before.get(name, 0.0)) / (k - first) for name, s in self._busy().items()}
        memory = (self.measured.total_memory - self.measured.free_memory) / 1e9 if self.measured.is_cuda else None
        self._results: dict[str, Any] = {"windows": self.windows, "device_memory_gb": memory, "nodes_ms": nodes}
        self.runtime.result(self, "meter", self._results)

    def _record(self, k: int, now: float) -> bool:
        """Begins to record the device, and ends it after some gaps."""
        if self.recording is None:
            try:
                self.recording = Recording(self.measured)
            except Exception as error:  # what was measured so far counts without it
                self._results["not_recorded"] = f"{type(error).__name__}: {error}"
                return True
            wp.synchronize()
            self._mark = Mark(k, time.perf_counter(), 0.0)
            return False
        first, began, _ = self._mark
        if self.recording.over:
            return True
        wall_ms = statistics.median(window["wall_ms"] for window in self.windows)
        if k - first < min(MOST_RECORDED, max(1, round(1e3 * self.params["window_s"] / wall_ms))):
            return False
        try:
            self._results["recorded"] = self.recording.end() | {"gaps": k - first, "wall_s": now - began}
        except Exception as error:
            self._results["not_recorded"] = f"{type(error).__name__}: {error}"
        return True
