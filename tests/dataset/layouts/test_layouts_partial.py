"""A reader reads of a long sequence what is asked for, in memory and from the disk."""

from __future__ import annotations

import dataclasses
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from sequences import EVERY, simulated

from evis.dataset.layouts import reader_of, writer_of
from evis.simulation.step import Step
from msgs.camera import EventPacket
from msgs.header import Header

STEPS, EVENTS, STEP_NS = 60, 20_000, 10_000_000
SHARE = {"mcap": 0.2, "dsec": 0.15, "zarr": 0.5}
"""Whole chunks are read, of 256 kB in HDF5 and 1 MB in bags and Zarr, which is much of a sequence as short as this."""


def busy_step(k: int) -> Step:
    """A step of many events at places and times of noise."""
    rng = np.random.default_rng(k)
    t = k * STEP_NS + 1 + np.sort(rng.integers(0, STEP_NS, EVENTS))
    x, y = (rng.integers(0, n, EVENTS).astype(np.uint16) for n in (64, 48))
    p = rng.integers(0, 2, EVENTS).astype(np.uint8)
    stamp = (k + 1) * STEP_NS
    packet = EventPacket(Header(stamp), np.array([0, EVENTS]), t, x, y, p, width=64, height=48, t0_ns=k * STEP_NS)
    return Step(stamp, np.zeros(1, np.int32), {"cam0": {"events": packet}}, {}, False)


def bytes_read() -> int:
    """What this process has read by system calls; parts of files that are mapped into memory are not among it."""
    lines = dict(line.split(": ") for line in Path("/proc/self/io").read_text().splitlines())
    return int(lines["rchar"])


@pytest.mark.parametrize("layout", EVERY)
def test_a_window_costs_its_part(layout: str, tmp_path: Path) -> None:
    """2 ms of 0.6 s: of the bytes, and of the memory that all events take, a tenth or what chunks make of it."""
    about, _ = simulated()
    about = dataclasses.replace(about, duration_ns=STEPS * STEP_NS, labels=())
    writer = writer_of(layout)(tmp_path / "s", about)
    for k in range(STEPS):
        writer.add(busy_step(k))
    writer.close()
    size = sum(path.stat().st_size for path in (tmp_path / "s").rglob("*") if path.is_file())
    reader = reader_of(layout)(tmp_path / "s")
    assert len(reader.events(0, 1_000_000).t) > 1000  # what is imported and gone over once
    before = bytes_read()
    tracemalloc.start()
    found = reader.events(303_000_000, 305_000_000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    read = bytes_read() - before
    want = busy_step(30).events
    assert want is not None and want.t is not None and want.x is not None
    t = want.t // 1000 * 1000 if layout == "dsec" else want.t
    part = (t >= 303_000_000) & (t < 305_000_000)
    assert np.array_equal(found.t, t[part]) and np.array_equal(found.x, want.x[part]) and len(found.t) > 3000
    share = SHARE.get(layout, 0.1)
    assert read < share * size and peak < share * STEPS * EVENTS * 13, (read / size, peak / (STEPS * EVENTS * 13))
