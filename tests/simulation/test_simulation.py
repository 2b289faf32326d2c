"""A graph held in Python gives what `evis launch` records, and begins anew as if it had never run."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.bag.decoded import decoded_events
from evis.bag.reader import BagReader

SIZE = {"width": 64, "height": 48}


def recorded(bag: Path, topic: str = "/cam0/events") -> dict[str, bytes]:
    """All events of a bag, by column."""
    with BagReader(bag) as reader:
        parts = [events for _, events in decoded_events(reader, topic)]
    return {name: b"".join(np.asarray(getattr(p, name)).tobytes() for p in parts) for name in "txyp"}


def columns(steps: Iterable[Any]) -> dict[str, bytes]:
    """All events of some steps, by column."""
    packets = [step.events for step in steps]
    return {name: b"".join(getattr(p, name).tobytes() for p in packets) for name in "txyp"}


def launch(folder: Path, *words: str) -> dict[str, bytes]:
    """What the command line records in 0.2 s."""
    bag = folder / "launched.mcap"
    command = [sys.executable, "-m", "evis.cli", "launch", *words, "--duration", "0.2", "--record", str(bag)]
    done = subprocess.run([*command, "--no-view", "--json"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["events"] > 0
    return recorded(bag)


@pytest.mark.parametrize(
    ("scene", "arguments"),
    [
        ("spinning_disk", {"omega": 30, "shot_rate": 5.0}),
        ("robot_arm", {"threshold_mismatch": 0.03, "interpolator": "splat"}),
    ],
)
def test_the_events_are_those_that_evis_launch_records(scene: str, arguments: dict[str, Any], tmp_path: Path) -> None:
    words = [f"{key}:={value}" for key, value in {**SIZE, **arguments, "seed": 5}.items()]
    with evis.Simulation(scene, seed=5, **SIZE, **arguments) as sim:
        assert columns(sim.run(0.2)) == launch(tmp_path, scene, *words)


def test_a_reset_run_is_the_first_run_again() -> None:
    """Also after another seed, whose events are others."""
    with evis.Simulation("robot_arm", seed=2, shot_rate=10.0, **SIZE) as sim:
        first = columns(sim.run(0.2))
        sim.reset(seed=3)
        other = columns(sim.run(0.2))
        again = columns([sim.reset(), *sim.run(0.2)])
    assert first == again
    assert other != first
