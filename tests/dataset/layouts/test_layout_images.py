"""Images of a simulated frame sensor in the layouts: several in a step, at times of their own, of 8 and 16 bits."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_recipe import write

import evis
from evis.cli import main
from evis.dataset.about import About
from evis.dataset.bag_sequence import export
from evis.dataset.layouts import LAYOUTS, reader_of, writer_of

ASKED = {"width": 64, "height": 48, "image_rate": 100.0, "image_phase_ms": 2.0, "exposure_ms": 5.0}
HELD = [name for name in LAYOUTS if name not in ("coco", "zarr")]
"""COCO has images for boxes alone; Zarr is npz's columns, and an extra."""


@functools.cache
def simulated(bits: int) -> tuple[About, tuple[Any, ...]]:
    with evis.Simulation("spinning_disk", outputs=["events", "info", "image"], image_bits=bits, **ASKED) as sim:
        steps = [*sim.run(0.1), sim.finish()]
    cameras = {"cam0": steps[0].cameras["cam0"].info}
    return About("a", "spinning_disk", {}, 0, 100_000_000, 30.0, cameras, ()), tuple(steps)


def images_of(steps: Any) -> list[Any]:
    return [image for step in steps for image in step.images]


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("layout", HELD)
def test_every_image_of_a_step_is_written_at_its_time(layout: str, bits: int, tmp_path: Path) -> None:
    about, steps = simulated(bits)
    writer = writer_of(layout)(tmp_path / "a", about)
    for step in steps:
        writer.add(step)
    writer.close()
    reader = reader_of(layout)(tmp_path / "a")
    told = reader.labels("image", 0, 10**12)
    wanted = images_of(steps)
    assert len(wanted) == 10 and max(len(step.images) for step in steps) == 4
    whole_us = layout in ("dsec", "mvsec")
    stamps = [i.header.stamp_ns for i in wanted]
    np.testing.assert_allclose(told["t"], stamps, atol=1000 if whole_us else 0)
    assert np.array_equal(told["image"], np.stack([i.data for i in wanted]))
    if "exposure_ns" in told:
        np.testing.assert_allclose(told["exposure_ns"], [i.exposure_ns for i in wanted], atol=1000 if whole_us else 0)
    assert reader.count == sum(len(step.events.t) for step in steps if step.events is not None)


@pytest.mark.parametrize("layout", HELD)
def test_a_bag_gives_the_same_images(layout: str, tmp_path: Path) -> None:
    with evis.Simulation("spinning_disk", outputs=["events", "info", "image"], envs=2, seed=3, **ASKED) as sim:
        sim.run(0.07)
        sim.save(tmp_path / "a.mcap")
    export(tmp_path / "a.mcap", layout, tmp_path / "b", env=1)
    with evis.Simulation("spinning_disk", outputs=["image"], seed=4, **ASKED) as sim:
        wanted = images_of(sim.run(0.07))
    told = reader_of(layout)(tmp_path / "b").labels("image", 0, 10**12)
    assert np.array_equal(told["image"], np.stack([i.data for i in wanted]))


def test_a_recipe_makes_sequences_with_images(tmp_path: Path) -> None:
    recipe = write(
        tmp_path,
        ("layout: npz\n", "layout: dsec\noutputs: [events, image]\n"),
        ("height: 24,", "height: 24, image_rate: 50,"),
    )
    assert main(["dataset", "make", str(recipe), "--out", str(tmp_path / "d"), "--count", "1"]) == 0
    found = sorted(path.parent.parent.parent.parent.name for path in tmp_path.glob("d/**/images/left/rectified/*.png"))
    assert len(set(found)) == 1 and len(found) == 5
    assert main(["dataset", "verify", str(tmp_path / "d")]) == 0
