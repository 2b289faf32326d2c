"""Environments that begin anew by themselves give the events of single runs, to the bit in time since their reset."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graphs import COLUMNS, Graph, assert_same_events

from msgs.camera import Frames
from msgs.own_time import ORIGIN

CHAINS = [
    ("spinning_disk", "rigid", "ideal"),
    ("falling_objects", "rigid", "davis346"),
    ("robot_arm", "splat", "imx636"),
    ("spinning_disk", "none", "davis346"),
]
MORE = [
    (scene, method, preset)
    for scene in ("spinning_disk", "falling_objects", "robot_arm")
    for method in ("rigid", "splat", "none")
    for preset in ("ideal", "davis346", "imx636")
    if (scene, method, preset) not in CHAINS
]


def keyframes(method: str, count: int) -> int:
    """States of as much time: without interpolation each frame is a keyframe."""
    return 4 * count if method == "none" else count


def check(tmp_path: Path, scene: str, method: str, preset: str, running: bool, envs: int = 3) -> None:
    """The last environment is reset with seed 77; the others go on, the one before it as a run of its own."""
    given: dict[str, Any] = {"interpolator": method, "preset": preset, "threshold": 0.2}
    before, after = keyframes(method, 3) + 1, keyframes(method, 4)
    batch = Graph(tmp_path / "batch", scene, envs=envs, seed=5, **given).step(before)
    packets = len(batch.packets)
    if running:
        batch.ask([envs - 1], [77])
        batch.step(1)
    else:
        batch.restart([envs - 1], [77])
    batch.step(after)
    neighbour = Graph(tmp_path / "neighbour", scene, seed=5 + envs - 2, **given).step(before + after + running)
    single = Graph(tmp_path / "single", scene, seed=77, **given).step(after + 1)
    for graph in (batch, neighbour, single):
        graph.end()
    origin = int(batch.states[-1].own[-1, ORIGIN])
    assert origin == round((before - (not running)) * 1e9 / batch.rate)
    truth = single.events(0)
    assert len(truth["t"]) > 500
    assert_same_events(batch.events(envs - 1, packets), truth, origin)
    assert_same_events(batch.events(envs - 2), neighbour.events(0))


@pytest.mark.parametrize(("scene", "method", "preset"), CHAINS)
def test_at_the_present_stamp(tmp_path, scene, method, preset):
    """As who steps the graph does it; stamps are rounded at 30 Hz."""
    check(tmp_path, scene, method, preset, running=False)


@pytest.mark.parametrize(("scene", "method", "preset"), CHAINS[:2])
def test_in_a_running_graph(tmp_path, scene, method, preset):
    """By a message, at the next stamp."""
    check(tmp_path, scene, method, preset, running=True)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "method", "preset"), MORE)
@pytest.mark.parametrize("running", [False, True])
def test_everywhere(tmp_path, scene, method, preset, running):
    check(tmp_path, scene, method, preset, running)


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["falling_objects", "spinning_disk"])
def test_one_of_sixteen(tmp_path, scene):
    """With a real sensor's faults."""
    check(tmp_path, scene, "rigid", "davis346", running=False, envs=16)


@pytest.mark.parametrize(
    "more",
    [
        {"crossing": "cubic"},
        {"readout_rate": 2e4},
        {"timestamp_jitter_us": 200.0},
        {"crossing": "cubic", "timestamp_jitter_us": 200.0},
        {"model": "evis-paper", "leak_rate": 9.0},
        {"bandwidth_hz": 60.0, "photoreceptor_noise": 0.1},
    ],
)
def test_what_a_sensor_holds_back_is_not_lost(tmp_path, more):
    """Look-ahead gives the events of who leaves and of who begins as a single run does, from a sensor that goes on with
    others and from one that ends. What waits for the readout is cut, and counted: it would have stamps of the next one.
    """
    given: dict[str, Any] = {"interpolator": "rigid", **more}
    batch = Graph(tmp_path / "batch", "spinning_disk", envs=2, **given).step(4)
    for _ in range(2):
        batch.restart([1], [8])
        batch.step(3)
    # The first keyframe of who begins is that of the reset.
    runs = [Graph(tmp_path / f"{k}", "spinning_disk", seed=seed, **given).step(4) for k, seed in enumerate((1, 8, 8))]
    for graph in (batch, *runs):
        graph.end()
    expected, cut = {name: [] for name in COLUMNS}, 0
    for k, run in enumerate(runs):
        alone = run.events(0)
        assert len(alone["t"]) > 100
        kept = (alone["t"] <= 100_000_000) | (k == 2)
        cut += int((~kept).sum())
        for name in COLUMNS:
            expected[name].append(alone[name][kept] + k * 100_000_000 * (name == "t"))
    assert_same_events(batch.events(1), {name: np.concatenate(parts) for name, parts in expected.items()})
    delays = "readout_rate" in more or "timestamp_jitter_us" in more
    assert (cut > 0) == delays and (not delays or batch.count("event_sensor", "readout_cut") == cut)


def test_a_seed_that_is_kept_gives_other_noise_each_time(tmp_path):
    """By the number of the reset: the disk turns the same way each time, so that nothing else differs."""
    given = {"interpolator": "rigid", "preset": "davis346", "shot_rate": 50.0, "timestamp_jitter_us": 50.0}
    batch = Graph(tmp_path / "batch", "spinning_disk", envs=2, **given)
    starts, found = [], []
    batch.step(3)
    for _ in range(3):
        starts.append(len(batch.packets))
        batch.restart([1])
        batch.step(3)
    batch.end()
    for first, last in zip(starts, [*starts[1:], None]):
        events = batch.events(1, first)
        end = len(events["t"]) if last is None else len(events["t"]) - len(batch.events(1, last)["t"])
        found.append(events["t"][:end].tobytes())
    assert all(found) and len(set(found)) == 3


def test_a_single_environment_in_a_running_graph(tmp_path):
    """Its stream goes on, and begins anew within it."""
    given: dict[str, Any] = {"interpolator": "rigid", "preset": "davis346"}
    graph = Graph(tmp_path / "a", "falling_objects", seed=2, **given).step(4)
    packets = len(graph.packets)
    graph.ask([], [9])
    graph.step(5)
    single = Graph(tmp_path / "b", "falling_objects", seed=9, **given).step(5)
    for one in (graph, single):
        one.end()
    assert_same_events(graph.events(0, packets), single.events(0), round(4e9 / 30))
    assert [p.header.episode for p in graph.packets[packets - 1 : packets + 1]] == [0, 1]


def test_a_reset_of_all_with_seeds_is_a_new_run(tmp_path):
    """Time, events and their noise, byte for byte, though each has a seed of its own."""
    given: dict[str, Any] = {"interpolator": "rigid", "preset": "davis346"}
    batch = Graph(tmp_path / "a", "falling_objects", envs=2, seed=2, **given).step(3)
    packets = len(batch.packets)
    batch.restart([], [30, 40])
    batch.step(4)
    singles = [Graph(tmp_path / f"{s}", "falling_objects", seed=s, **given).step(5) for s in (30, 40)]
    for one in (batch, *singles):
        one.end()
    for env in (0, 1):
        assert_same_events(batch.events(env, packets), singles[env].events(0))


def test_frames_tell_the_own_times(tmp_path):
    """One row per environment, between its own stamps; nobody has any before the first reset."""
    graph = Graph(tmp_path / "a", "spinning_disk", envs=2, interpolator="rigid", kept=(Frames,)).step(2)
    assert all(m.own is None and m.own_t is None for m in graph.messages)
    graph.restart([1])
    graph.step(1)
    graph.end()
    begin, last = graph.messages[-2:]
    assert begin.own_t.tolist() == [[33333333], [0]] and begin.t.tolist() == [33333333]
    assert last.own_t[1].tolist() == [8333333, 16666667, 25000000, 33333333]
    assert last.own_t[0].tolist() == last.t.tolist() and np.all(np.diff(last.t) > 0)


def test_who_is_not_there_is_refused_and_the_graph_goes_on(tmp_path):
    graph = Graph(tmp_path / "a", "spinning_disk", envs=2, interpolator="rigid").step(2)
    graph.ask([7], [1])
    graph.step(2)
    graph.end()
    assert graph.count("physics", "resets_refused") == 1
    assert len(graph.packets) == 4 and all(s.episodes.tolist() == [0, 0] for s in graph.states)
