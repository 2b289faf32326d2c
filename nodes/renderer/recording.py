"""Sequences of launches that are the same every time, as CUDA graphs."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

import warp as wp

MOST = 64
"""Graphs that are kept; who writes into ever new arrays has them recorded anew."""


class Recording:
    """Runs sequences of launches, each told by a key that says all that can differ between two runs of it.

    On a GPU the first run loads the kernels, the second one is recorded as a graph, and all others are one launch.
    """

    def __init__(self, device: Any) -> None:
        self.device = device
        self._graphs: dict[Hashable, Any] = {}

    def run(self, key: Hashable, launch: Callable[[], None]) -> None:
        """What `launch` does; it must read nothing back and allocate nothing."""
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
