"""An environment that diverges amid others begins its next episode with one frame, as a run by itself does."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graphs import Graph, assert_same_events

from nodes.event_sensor.environments.separate import SeparateSensors
from nodes.event_sensor.sensor import EventSensor

MODEL = """
<mujoco><option timestep="0.001" gravity="0 0 -3000"/><worldbody><body name="rock" pos="0 0 0.5">
<joint name="j" type="slide" axis="0 0 -1"/><geom type="box" size="0.4 0.4 0.4" mass="1"/></body></worldbody></mujoco>
"""
SCENE = """
args: {start: {default: {from: 0, to: 900}, help: speed at the start}}
mjcf: fall.xml
initial_joints: {j: {velocity: "${start}"}}
cameras: {cam0: {position: [0, -3, 1], look_at: [0, 0, 0.5], fov: 50 deg}}
environment: 0.5
"""
NOISE = {"shot_rate": 20.0, "leak_rate": 20.0, "threshold_mismatch": 0.04, "threshold": 0.2}
SEED, ENVS, STEPS = 4, 3, 12


@pytest.mark.parametrize(
    "sensor",
    [
        NOISE,
        {**NOISE, "crossing": "cubic", "readout_rate": 30000.0, "timestamp_jitter_us": 100.0},
        {**NOISE, "time_tolerance": 0.0005},
    ],
    ids=["noise", "held back", "samples"],
)
def test_a_divergence_amid_others_gives_the_events_of_a_single_run(tmp_path: Path, sensor: dict[str, Any]) -> None:
    """A fall passes the speed limit every fourth gap in the first environment, once or twice in the others."""
    (tmp_path / "fall.xml").write_text(MODEL)
    scene = tmp_path / "fall.yaml"
    scene.write_text(SCENE)
    batch = Graph(tmp_path / "batch", str(scene), envs=ENVS, seed=SEED, **sensor).step(STEPS)
    batch.end()
    assert batch.states[-1].episodes[0] >= 2 and len(set(batch.states[-1].episodes.tolist())) > 1
    for env in range(ENVS):
        single = Graph(tmp_path / f"single{env}", str(scene), seed=SEED + env, **sensor).step(STEPS)
        single.end()
        assert len(single.events(0)["t"]) > 500
        assert_same_events(batch.events(env), single.events(0))
        # What was held back until the end begins where the packet before it ended.
        assert batch.packets[-1].t0_ns == single.packets[-1].t0_ns


def test_sensors_of_different_parameters_begin_with_the_last_frame_too() -> None:
    """They stay side by side: the one that begins an episode amid others sees what it would see by itself."""
    made = [EventSensor(6, 8, seed=s, shot_rate=r, leak_rate=20.0) for s, r in ((1, 300.0), (2, 500.0), (2, 500.0))]
    both, single = SeparateSensors(made[:2]), made[2]
    light = np.full((2, 4, 6, 8), 0.3, np.float32)
    t, found, alone = np.arange(1, 5) * 5_000_000, [], []
    for call in range(3):
        numbers, first = np.array([0, int(call > 0)]), 3 if call == 1 else 0
        count = both.advance(light, t + call * 20_000_000, numbers)
        out = {name: np.empty(count, dtype) for name, dtype in both.columns().items()}
        both.read(out)
        found.append(out["t"][both.env_offsets()[1] :])
        alone.append(single.process(light[:1, first:], t[first:] + call * 20_000_000, numbers[1:]).t)
    assert [len(times) for times in alone][1] == 0 < min(len(alone[0]), len(alone[2]))
    assert [times.tolist() for times in found] == [times.tolist() for times in alone]
