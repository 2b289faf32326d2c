"""Measures how many events a second a bag takes, by the number of threads and by the size of the messages.

    python -m bench.graph.recording [--quick]

Packets are 640x480, their events drawn at random in the order of time, 8 bytes each in a bag; zstd takes a fifth off
them, as off those of a textured scene. The bag lies in memory (/dev/shm) where the machine has that, so that no disk is
measured. Every packet is in the file when the next one is given.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench import command
from evis.bag.threads import MOST_THREADS
from evis.bag.writer import BagWriter
from msgs.camera import EventPacket
from msgs.header import Header

COMMAND = "python -m bench.graph.recording"
GAP_NS = 33_333_333
DRAWN = 4_000_000
SIZES = ((1, 25_000), (1, 100_000), (1, 1_000_000), (256, 1_000_000))
"""Environments, and events of a packet: of a gap of 1 ms, of some ms, of 33 ms, and of environments side by side."""


def packets(envs: int, count: int, total: int) -> Iterator[EventPacket]:
    """Makes packets, until there are `total` events; what is in them comes again after 4 million."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(1, GAP_NS, count))
    xs, ys = rng.integers(0, 640, DRAWN, np.uint16), rng.integers(0, 480, DRAWN, np.uint16)
    ps = rng.integers(0, 2, DRAWN, np.uint8)
    offsets = np.linspace(0, count, envs + 1).astype(np.int64)
    for k in range(total // count):
        header, at = Header((k + 1) * GAP_NS, k), k * count % DRAWN
        x, y, p = (column[at : at + count] for column in (xs, ys, ps))
        yield EventPacket(header, offsets, t + k * GAP_NS, x, y, p, width=640, height=480, t0_ns=k * GAP_NS)


def record(path: Path, envs: int, count: int, total: int, threads: int) -> tuple[float, float]:
    """Measures (wall, CPU) seconds of recording `total` events, closing included, and of nothing else."""
    wall = cpu = 0.0
    writer = BagWriter(path, threads=threads)
    for packet in packets(envs, count, total):
        start = time.perf_counter(), time.process_time()
        writer.write("/cam0/events", packet)
        wall, cpu = wall + time.perf_counter() - start[0], cpu + time.process_time() - start[1]
    start = time.perf_counter(), time.process_time()
    writer.close()
    return wall + time.perf_counter() - start[0], cpu + time.process_time() - start[1]


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures millions of events per second of wall time, and of one core's time; medians."""
    total, repeats = (20_000_000, 3) if quick else (60_000_000, 5)
    cores = len(os.sched_getaffinity(0))
    counts = sorted({1, 2, 4, MOST_THREADS, 16} & set(range(1, cores + 1)))
    memory = Path("/dev/shm")
    rows = []
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        path = Path(folder) / "a.mcap"
        for envs, count in SIZES:
            results: dict[int, list[tuple[float, float]]] = {threads: [] for threads in counts}
            for _ in range(repeats):  # in turn, so that a change of the machine's load meets all
                for threads in counts:
                    results[threads].append(record(path, envs, count, total, threads))
                    size = path.stat().st_size
                    path.unlink()
            for threads, found in results.items():
                rows.append({
                    "environments": envs,
                    "events a packet": count,
                    "threads": threads,
                    "Mev/s": round(total / statistics.median(wall for wall, _ in found) / 1e6, 1),
                    "Mev/s a core": round(total / statistics.median(cpu for _, cpu in found) / 1e6, 1),
                    "bytes an event": round(size / total, 2),
                })  # fmt: skip
    return {
        "rates": {
            "title": "Recording of events, by threads",
            "command": COMMAND,
            "rows": rows,
            "note": f"{cores} cores. A packet is in the file when the next one is given; the bag is in memory. "
            "'a core': by the processor time of all threads together.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
