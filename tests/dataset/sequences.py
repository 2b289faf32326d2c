"""A short labelled simulation, run once, and what a sequence in any layout is to hold of it."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np

import evis
from evis.dataset.about import About
from evis.dataset.layouts import writer_of
from evis.simulation.step import Step

LABELS = (
    "forward_flow", "backward_flow", "boxes", "depth", "segmentation", "semantic", "events", "poses", "boxes3d",
)  # fmt: skip
DURATION_NS = 133_333_333
"""Four intervals of 30 Hz; no whole number of milliseconds."""


@functools.cache
def simulated(scene: str = "spinning_disk", *labels: str, **arguments: Any) -> tuple[About, tuple[Step, ...]]:
    """The steps of a run, with what a writer is told of it. Nobody writes into them."""
    asked = labels or LABELS
    given = {"width": 64, "height": 48, **arguments}
    outputs = ["events", "info", *(f"labels.{kind}" for kind in asked)]
    with evis.Simulation(scene, outputs=outputs, seed=4, **given) as sim:
        steps = [sim.reset(), *(sim.step() for _ in range(4)), sim.finish()]
    cameras = {name: outputs.info for name, outputs in steps[0].cameras.items()}
    return About("a", scene, given, 4, DURATION_NS, 30.0, cameras, asked), tuple(steps)


def written(layout: str, directory: Path, about: About, steps: tuple[Step, ...]) -> Any:
    """Writes a sequence; returns its writer."""
    writer = writer_of(layout)(directory, about)
    for step in steps:
        writer.add(step)
    writer.close()
    return writer


def events_of(steps: tuple[Step, ...], camera: str) -> dict[str, np.ndarray]:
    """All events of a camera, t, x, y, p."""
    packets = [p for step in steps if (p := vars(step.cameras[camera]).get("events")) is not None]
    return {name: np.concatenate([getattr(p, name) for p in packets]) for name in "txyp"}


def labels_of(steps: tuple[Step, ...], camera: str, name: str) -> tuple[np.ndarray, list[np.ndarray]]:
    """The stamps at which there is an array of the labels, and the array at each."""
    found = [
        (step.stamp_ns, getattr(labels, name))
        for step in steps
        if (labels := vars(step.cameras[camera]).get("labels")) is not None and getattr(labels, name) is not None
    ]
    return np.array([stamp for stamp, _ in found]), [array for _, array in found]
