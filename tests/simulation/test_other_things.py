"""Seeds that draw other bodies: a simulation begins another run with them, and single environments refuse them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.scene import load_scene
from evis.simulation.errors import SimulationError

SCENE = """
args: {count: {default: {from: 1, to: 4.99}, help: how many}}
bodies:
  ball:
    position: ["${0.3 * k}", 0, 0]
    motion: {kind: sinusoid, amplitude: [0.2, 0, 0], frequency: 5}
    shapes: [{shape: sphere, radius: 0.1, material: grey}]
    copies: {over: {k: "${count // 1}"}}
materials: {grey: {albedo: 0.4}}
cameras: {cam0: {position: [0.3, -2, 0.2], look_at: [0.3, 0, 0], fov: 50 deg}}
environment: 0.7
"""
OUTPUTS = ["events", "labels.segmentation", "state"]


@pytest.fixture
def scene(tmp_path: Path) -> str:
    """The scene, in a file."""
    path = tmp_path / "balls.yaml"
    path.write_text(SCENE)
    return str(path)


def seeds_of_other_counts(scene: str) -> tuple[int, int, int]:
    """Finds a seed and the next one with as many bodies, and a seed with others."""
    counts = [len(load_scene(scene, seed=seed).bodies) for seed in range(40)]
    first = next(s for s in range(39) if counts[s] == counts[s + 1])
    return first, first + 1, next(s for s in range(40) if counts[s] != counts[first])


def course(simulation: evis.Simulation, **reset: Any) -> list[bytes]:
    """Runs a simulation from a reset on; gives its events and states."""
    steps = [simulation.reset(**reset), *simulation.run(0.1)]
    found = [a.tobytes() for s in steps if s.events is not None for a in (s.events.t, s.events.x, s.events.p)]
    assert sum(map(len, found)) > 0
    return found + [rows.tobytes() for s in steps for rows in s.state.rows()]


def test_a_simulation_begins_another_run_with_what_a_seed_draws(scene: str) -> None:
    one, _alike, other = seeds_of_other_counts(scene)
    made = {"outputs": OUTPUTS, "width": 48, "height": 32}
    with evis.Simulation(scene, seed=one, **made) as simulation:
        courses = {seed: course(simulation, seed=seed) for seed in (one, other)}
        assert course(simulation, seed=one) == courses[one] != courses[other]
    with evis.Simulation(scene, seed=other, **made) as alone:
        assert course(alone) == courses[other]


def test_a_single_environment_refuses_other_things_and_the_run_goes_on(scene: str) -> None:
    one, alike, other = seeds_of_other_counts(scene)
    assert alike == one + 1
    made = {"outputs": OUTPUTS, "width": 48, "height": 32, "envs": 2, "seed": one}
    with evis.Simulation(scene, **made) as simulation, evis.Simulation(scene, **made) as undisturbed:
        simulation.run(0.1)
        undisturbed.run(0.1)
        with pytest.raises(SimulationError, match=r"bodies of environment 1, of seed \d+, are not those"):
            simulation.reset(seed=[other], envs=[1])
        mine, others = simulation.run(0.1), undisturbed.run(0.1)
        for a, b in zip(mine, others, strict=True):
            assert np.array_equal(a.events.t, b.events.t) and a.episodes.tolist() == [0, 0]
