"""Measures the greatest rates of a device: bytes per second from memory and caches, float32 operations per second."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from bench.roofline.ceilings_kernels import CHAINS, compute, read_again

REPEATS = 7
READ_BYTES = 16


@dataclass(frozen=True)
class Ceilings:
    """Holds rates: memory and cache in bytes a second, operations in float32 operations a second."""

    memory: float
    cache: float
    operations: float


def measured(device: str) -> Ceilings:
    """Measures the rates of a device; of a CPU those of one core, as a Warp kernel attains them."""
    cpu = wp.get_device(device).is_cpu
    memory = copied(device, 1 << (26 if cpu else 28))
    sums: wp.array = wp.zeros(1, dtype=float, device=device)
    # In the caches of a GPU together, and in that of one core.
    held: wp.array = wp.zeros(1 << (14 if cpu else 20), dtype=wp.vec4, device=device)
    threads, rounds = (1 << 10, 1 << 12) if cpu else (1 << 20, 1 << 9)
    read = lambda: wp.launch(read_again, dim=threads, inputs=[held, rounds], outputs=[sums], device=device)
    # A copy on a CPU has wider instructions than a kernel; on a GPU it is over before the next one is launched.
    cache = max(READ_BYTES * threads * rounds / fastest(device, read), copied(device, 1 << 17))
    rounds = (1 << 11) if cpu else (1 << 12)
    calculate = lambda: wp.launch(compute, dim=threads, inputs=[0.5, rounds], outputs=[sums], device=device)
    return Ceilings(memory, cache, CHAINS * threads * rounds / fastest(device, calculate))


def copied(device: str, length: int) -> float:
    """Measures how many bytes a second the copy of a float32 array reads and writes."""
    one, other = (wp.zeros(length, dtype=wp.float32, device=device) for _ in range(2))
    return 8 * length / fastest(device, lambda: wp.copy(other, one))


def fastest(device: str, work: Callable[[], object]) -> float:
    """Measures the least time [s] that work takes, after once that loads its kernel."""
    times = []
    for _ in range(1 + REPEATS):
        wp.synchronize_device(device)
        began = time.perf_counter()
        work()
        wp.synchronize_device(device)
        times.append(time.perf_counter() - began)
    return min(times[1:])
