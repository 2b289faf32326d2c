"""Rows of an image shared by CPU threads."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import warp as wp

from evis.runtime.workers import Workers

PARTS = 4
"""Parts of a thread's work where pixels differ in cost: what is left waits for the slowest of many, not of two."""


class RowTiles:
    """Rows split over threads, for kernels that write only the rows they are given.

    rows: first and end of each thread's. parts: the same in smaller ones, each taken by the next thread that is free,
    for kernels that cost as much as their pixels and nothing besides.
    """

    def __init__(self, height: int, threads: int) -> None:
        count = max(1, min(threads, height))
        self.rows = _split(height, count)
        self.parts = _split(height, min(PARTS * count, height)) if count > 1 else self.rows
        self._pool = Workers(count) if count > 1 else None

    def launch(self, kernel: wp.Kernel, arguments: Any, device: Any, block: int = 256, in_parts: bool = False) -> None:
        """Runs `kernel` once for each of `rows` or of `parts`; arguments(row0, row1) gives its launch dimensions and
        inputs."""
        commands = []
        for row0, row1 in self.parts if in_parts else self.rows:
            dim, inputs = arguments(row0, row1)
            if self._pool is None:
                wp.launch(kernel, dim=dim, inputs=inputs, device=device, block_dim=block)
            else:
                commands.append(wp.launch(kernel, dim=dim, inputs=inputs, device=device, record_cmd=True))
        if self._pool is not None:
            list(self._pool.map(lambda command: command.launch(), commands))


def _split(height: int, count: int) -> list[tuple[int, int]]:
    return list(pairwise(height * k // count for k in range(count + 1)))
