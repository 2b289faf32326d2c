"""What a writer holds does not grow with the length of a sequence."""

from __future__ import annotations

import dataclasses
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from sequences import EVERY, simulated

from evis.dataset.layouts import writer_of
from evis.simulation.step import Step

STEP_NS = 33_333_333


def later(step: Step, by_ns: int) -> Step:
    """The step as it would be at another time."""
    outputs = vars(step.cameras["cam0"])
    events = outputs["events"]
    moved = dataclasses.replace(events, t=events.t + by_ns, t0_ns=events.t0_ns + by_ns)
    labels = outputs["labels"]
    between = labels.flow_t + by_ns
    again = dataclasses.replace(labels, flow_t=between)
    values = {**outputs, "events": moved, "labels": again}
    return Step(step.stamp_ns + by_ns, np.zeros(1, np.int32), {"cam0": values}, {}, False)


@pytest.mark.parametrize("layout", EVERY)
def test_memory_does_not_grow(layout: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """40 more steps take no more at their peak than those before, but for a hundredth of what is written."""
    before = 40
    if layout == "zarr":  # smaller chunks, and enough steps that those of images have been full once
        before = 120
        monkeypatch.setattr("evis.dataset.layouts.zarr.writer._CHUNK_BYTES", 1 << 14)
    about, steps = simulated()
    writer = writer_of(layout)(tmp_path / "s", dataclasses.replace(about, duration_ns=(before + 41) * STEP_NS))
    tracemalloc.start()
    peaks = []
    for part in (range(before), range(before, before + 40)):
        tracemalloc.reset_peak()
        written = 0
        for k in part:
            step = later(steps[1], k * STEP_NS)
            written += sum(array.nbytes for array in step.events.arrays().values())  # type: ignore[union-attr]
            written += sum(array.nbytes for array in step.labels.arrays().values())  # type: ignore[union-attr]
            writer.add(step)
        peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    writer.close()
    assert written > 4_000_000 and peaks[1] - peaks[0] < 0.01 * written, peaks
