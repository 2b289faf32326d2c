"""A reset to a seed that draws a sensor which cannot be there is refused, and the graph goes on."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graphs import Graph, assert_same_events

import evis
from evis.scene import load_scene

SCENE = """
args: {{drawn: {{default: {{from: 0, to: 1.99}}, help: which sensor}}}}
bodies:
  blade:
    motion: {{kind: spin, axis: [0, 1, 0], rate: 30}}
    shapes: [{{shape: box, size: [0.4, 0.1, 0.1], material: grey}}]
materials: {{grey: {{albedo: 0.8}}}}
cameras: {{cam0: {{fov: 50 deg, position: [0, -1, 0], look_at: [0, 0, 0]}}}}
environment: 0.3
sensor: {sensor}
"""
SENSORS: dict[str, tuple[str, str, dict[str, Any], str]] = {
    "noise beside marked events": (
        '{bandwidth_hz: 60, photoreceptor_noise: "${drawn // 1 * 0.05}"}',
        "photoreceptor_noise", {"labels": "events"}, "leave out labels:=events",
    ),
    "noise without a bandwidth": (
        '{photoreceptor_noise: 0.05, bandwidth_hz: "${60 - drawn // 1 * 60}"}', "bandwidth_hz", {}, "give one",
    ),
    "another crossing": (
        "{crossing: \"${'linear' if drawn < 1 else 'monotone'}\"}", "crossing", {}, "crossing is monotone",
    ),
}  # fmt: skip


@pytest.fixture(params=SENSORS)
def drawn(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, int, int, dict[str, Any], str]:
    """A scene, a seed from which on three draw a sensor that can be, one that does not, arguments, what is said."""
    sensor, name, given, says = SENSORS[request.param]
    path = tmp_path / "drawn.yaml"
    path.write_text(SCENE.format(sensor=sensor))
    values = [load_scene(str(path), seed=seed).sensor[name] for seed in range(60)]
    can = {"photoreceptor_noise": 0, "bandwidth_hz": 60, "crossing": "linear"}[name]
    good = next(s for s in range(50) if values[s : s + 3] == [can] * 3)
    return str(path), good, next(s for s in range(60) if values[s] != can), given, says


def test_a_graph_that_runs_goes_on(drawn: tuple[str, int, int, dict[str, Any], str], tmp_path: Path) -> None:
    scene, good, bad, given, _ = drawn
    asked, undisturbed = (Graph(tmp_path / name, scene, envs=3, seed=good, **given).step(3) for name in "ab")
    asked.ask([1], [bad])
    asked.step(4)
    undisturbed.step(4)
    asked.ask([1], [good])  # one that can be is taken
    asked.step(1)
    assert asked.count("physics", "resets_refused") == 1 and asked.count("physics", "resets") == 1
    for graph in (asked, undisturbed):
        graph.end()
    assert all(state.episodes.tolist() == [0, 0, 0] for state in asked.states[:7])
    for env in range(3):
        del asked.packets[len(undisturbed.packets) :]
        assert_same_events(asked.events(env), undisturbed.events(env))
        assert len(undisturbed.events(env)["t"]) > 50


def test_who_steps_a_graph_is_told_and_goes_on(drawn: tuple[str, int, int, dict[str, Any], str]) -> None:
    scene, good, bad, given, says = drawn
    outputs = ["events", "labels.events"] if given else ["events"]
    with evis.Simulation(scene, outputs=outputs, width=40, height=30, envs=2, seed=good) as sim:
        sim.reset()
        sim.step()
        with pytest.raises(evis.SimulationError, match=f"environment 1 cannot begin anew with seed {bad}: .*{says}"):
            sim.reset(seed=[bad], envs=[1])
        assert sim.step().episodes.tolist() == [0, 0]


def test_all_environments_may_draw_another_crossing_than_the_constructors(tmp_path: Path) -> None:
    """As long as they agree with each other; each has the events of a simulation with its seed alone."""
    scene = tmp_path / "drawn.yaml"
    scene.write_text(SCENE.format(sensor=SENSORS["another crossing"][0]))
    drawn = [load_scene(str(scene), seed=seed).sensor["crossing"] for seed in range(60)]
    linear = drawn.index("linear")
    # The seed after the first one draws linear again, and is nobody's.
    first = next(s for s in range(50) if drawn[s : s + 2] == ["monotone", "linear"])
    second = next(s for s in range(first + 2, 60) if drawn[s] == "monotone")
    size = {"width": 40, "height": 30}
    with evis.Simulation(str(scene), envs=2, seed=linear, **size) as sim:
        sim.reset(seed=[first, second])
        steps = [sim.step() for _ in range(3)]
        for env, seed in enumerate((first, second)):
            with evis.Simulation(str(scene), seed=seed, **size) as single:
                single.reset()
                for step in steps:
                    mine, alone = sim.alone(step, env).events, single.step().events
                    assert all(np.array_equal(getattr(mine, name), getattr(alone, name)) for name in "txyp")
                    assert len(alone.t) > 20
        says = f"environment 1 cannot begin anew .* linear with seed {linear} and monotone with seed {first}"
        with pytest.raises(evis.SimulationError, match=says):
            sim.reset(seed=[first, linear])
        assert sim.step().stamp_ns  # in a run with the constructor's seed
