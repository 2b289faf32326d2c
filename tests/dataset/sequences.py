"""A short labelled simulation, run once, and what a sequence in any layout is to hold of it."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.dataset.about import About
from evis.dataset.layouts import LAYOUTS, writer_of
from evis.simulation.step import Step
from msgs.camera import Image
from msgs.header import Header

LABELS = (
    "forward_flow", "backward_flow", "boxes", "depth", "segmentation", "semantic", "events", "poses", "boxes3d",
)  # fmt: skip
EVERY = tuple(pytest.param(name, marks=pytest.mark.extras) if name == "zarr" else name for name in LAYOUTS)
"""Every layout, as a parameter of tests: the package zarr is an extra."""
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


def framed(steps: tuple[Step, ...], exposure_ns: int = 4_000_000) -> tuple[Step, ...]:
    """The steps with a grey frame of noise beside the labels of each camera, of their stamp."""
    made = []
    for k, step in enumerate(steps):
        cameras = {}
        for n, (name, outputs) in enumerate(step.cameras.items()):
            cameras[name] = dict(vars(outputs))
            if cameras[name].get("labels") is not None:
                info = steps[0].cameras[name].info
                pixels = np.random.default_rng((k, n)).integers(0, 255, (info.height, info.width, 1), np.uint8)
                cameras[name]["image"] = Image(Header(step.stamp_ns), pixels, "mono8", exposure_ns)
        made.append(Step(step.stamp_ns, step.episodes, cameras, {}, step.over))
    return tuple(made)


def frames_of(steps: tuple[Step, ...], camera: str) -> np.ndarray:
    """The frames of a camera, [T, H, W, 1]."""
    images = [vars(step.cameras[camera]).get("image") for step in steps]
    return np.stack([image.data for image in images if image is not None])
