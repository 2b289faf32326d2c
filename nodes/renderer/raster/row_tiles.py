"""Divides the rows of an image among CPU threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any

import warp as wp

from evis.runtime.workers import Workers, edges_of

PARTS = 4
"""Parts of a thread's work where pixels differ in cost: what is left waits for the slowest of many, not of two."""


class RowTiles:
    """Splits rows over threads, for kernels that write only the rows they are given.

    rows: first and end of each thread's. parts: the same in smaller ones, each taken by the next thread that is free,
    for kernels that cost as much as their pixels and nothing besides.
    """

    def __init__(self, height: int, threads: int) -> None:
        count = max(1, min(threads, height))
        self.rows = list(pairwise(edges_of(height, count)))
        self.parts = list(pairwise(edges_of(height, min(PARTS * count, height)))) if count > 1 else self.rows
        self._pool = Workers(count) if count > 1 else None

    def launch(self, kernel: wp.Kernel, arguments: Any, device: Any, block: int = 256, in_parts: bool = False) -> None:
        """Runs `kernel` once for each of `rows` or of `parts`; arguments(row0, row1) gives its launch dimensions and
        inputs."""
        rows = self.parts if in_parts else self.rows
        if self._pool is not None:
            launch_in_threads(self._pool, [(kernel, *arguments(*ends)) for ends in rows])
            return
        for ends in rows:
            dim, inputs = arguments(*ends)
            wp.launch(kernel, dim=dim, inputs=inputs, device=device, block_dim=block)


def launch_in_threads(pool: ThreadPoolExecutor, launches: Sequence[tuple[wp.Kernel, Any, list[Any]]]) -> None:
    """Runs kernels, (kernel, dimensions, arguments), on a CPU side by side in the threads of a pool, and waits."""
    calls: list[Callable[[], Any]] = []
    loaded = set[int]()
    for kernel, dim, given in launches:
        if not dim:
            continue
        if id(kernel) in loaded:
            # Its arguments are packed in its thread, meanwhile others compute.
            calls.append(partial(wp.launch, kernel, dim, given, device="cpu"))
        else:
            # What compiles and loads a kernel is not for several threads at once.
            calls.append(wp.launch(kernel, dim, given, device="cpu", record_cmd=True).launch)
            loaded.add(id(kernel))
    list(pool.map(lambda call: call(), calls))
