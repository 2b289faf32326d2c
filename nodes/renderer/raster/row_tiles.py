"""Rows of an image shared by CPU threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import warp as wp


class RowTiles:
    """Rows split over threads, for kernels that write only the rows they are given."""

    def __init__(self, height: int, threads: int) -> None:
        count = max(1, min(threads, height))
        edges = [height * k // count for k in range(count + 1)]
        self.rows = list(pairwise(edges))
        self._pool = ThreadPoolExecutor(count) if count > 1 else None

    def launch(self, kernel: wp.Kernel, arguments: Any, device: Any, block: int = 256) -> None:
        """Runs `kernel` once per band; arguments(row0, row1) gives its launch dimensions and inputs."""
        commands = []
        for row0, row1 in self.rows:
            dim, inputs = arguments(row0, row1)
            if self._pool is None:
                wp.launch(kernel, dim=dim, inputs=inputs, device=device, block_dim=block)
            else:
                commands.append(wp.launch(kernel, dim=dim, inputs=inputs, device=device, record_cmd=True))
        if self._pool is not None:
            list(self._pool.map(lambda command: command.launch(), commands))
