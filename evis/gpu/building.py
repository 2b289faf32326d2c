"""Kernels compiled side by side before they are launched, for at a launch each is compiled by itself."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import warp as wp

LAUNCH_BLOCK = 256
"""Threads of a block where a launch does not say."""
MOST_AT_ONCE = 8
"""A compiler takes some 100 MB."""
FEWEST_CORES = 4
"""With fewer it costs what it saves: on a CPU a compiler reads Warp's headers once for each thread, for 1.2 s."""


@cache
def _helpers() -> ThreadPoolExecutor:
    """Threads that stay, for what they have read does."""
    return ThreadPoolExecutor(MOST_AT_ONCE, "build")


def build_together(device: Any, kernels: Iterable[tuple[wp.Kernel, int]]) -> None:
    """Compiles kernels and loads them on a device, several at once; from Warp's cache what is there.

    kernels: those that take longest first, each with the threads of a block that it will be launched with, which count
    on a GPU only. One that is not launched after all costs the time to compile it. Raises what a launch would.
    """
    cores = len(os.sched_getaffinity(0))
    if cores < FEWEST_CORES:
        return  # a launch does the same
    on_cpu = wp.get_device(device).is_cpu
    wanted = deque(dict.fromkeys((kernel.module, None if on_cpu else block) for kernel, block in kernels))
    at_once = min(len(wanted), MOST_AT_ONCE, cores)

    def build() -> None:
        while wanted:
            try:
                module, block = wanted.popleft()
            except IndexError:
                return  # another one has just taken the last
            wp.force_load(device, [module], block, max_workers=0)

    others = [_helpers().submit(build) for _ in range(at_once - 1)]
    try:
        build()
    finally:
        for other in others:
            other.result()
