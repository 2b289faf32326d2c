"""Records sequences of launches that are the same every time as CUDA graphs."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any

import warp as wp

MOST = 64
"""Graphs that are kept; who writes into ever new arrays has them recorded anew."""


class Branch:
    """Runs launches beside others, on a stream of its own; a recorded graph keeps that. On a CPU all are in their
    order."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self._stream = wp.Stream(device) if device.is_cuda else None

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Launches what is within its block after all before it, and beside all after it until `join`."""
        if self._stream is None:
            yield
            return
        with wp.ScopedStream(self._stream):
            yield

    def join(self) -> None:
        """Makes what follows wait for all that was launched aside."""
        if self._stream is not None:
            self._device.stream.wait_stream(self._stream)


class CudaGraphs:
    """Runs sequences of launches, each told by a key that says all that can differ between two runs of it.

    On a GPU the first run loads the kernels, the second one is recorded as a graph, and all others are one launch.
    """

    def __init__(self, device: Any) -> None:
        self.device = device
        self._graphs: dict[Hashable, Any] = {}

    def run(self, key: Hashable, launch: Callable[[], None]) -> None:
        """Runs `launch`, from its second call with a key on as one recorded graph; it must read nothing back and
        allocate nothing."""
        if self.device.is_cpu or self.device.is_capturing:
            launch()
            return
        if key not in self._graphs:
            if len(self._graphs) >= MOST:
                self._graphs.clear()
            self._graphs[key] = None
            launch()
            return
        if self._graphs[key] is None:
            with wp.ScopedCapture(self.device) as capture:
                launch()
            self._graphs[key] = capture.graph
        wp.capture_launch(self._graphs[key])
