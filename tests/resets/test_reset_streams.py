"""What else comes of a reset: inertial samples, cameras with a rate of their own, bags."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from graphs import Graph, assert_same_events

from evis.bag.reader import BagReader
from msgs.camera import Imu
from msgs.world import WorldState


def test_inertial_samples_are_those_of_a_single_run(tmp_path):
    """In time since the reset; with the noise of the new seed."""
    given: dict[str, Any] = {"interpolator": "rigid", "imu": True, "kept": (Imu,)}
    graph = Graph(tmp_path / "a", "spinning_disk", seed=2, **given).step(4)
    before = len(graph.messages)
    graph.ask([], [9])
    graph.step(5)
    single = Graph(tmp_path / "b", "spinning_disk", seed=9, **given).step(5)
    for one in (graph, single):
        one.end()
    made, truth = graph.messages[before:], single.messages
    assert len(made) == len(truth) == 5
    for mine, other in zip(made, truth):
        assert np.array_equal(mine.t - round(4e9 / 30), other.t)
        assert mine.acceleration.tobytes() == other.acceleration.tobytes()
        assert mine.angular_velocity.tobytes() == other.angular_velocity.tobytes()


@pytest.mark.parametrize("keyframes", [3, 4])
def test_a_camera_with_a_slower_rate(tmp_path, keyframes):
    """At a keyframe of the camera (after 3 states) it is a single run's; between two of them the others go on."""
    given: dict[str, Any] = {"interpolator": "rigid", "camera_rate": "cam0=15", "seed": 5}
    graph = Graph(tmp_path / "a", "falling_objects", envs=2, **given).step(keyframes)
    packets = len(graph.packets)
    graph.restart([1], [77])
    graph.step(10 - keyframes % 2)
    other = Graph(tmp_path / "b", "falling_objects", **given).step(keyframes + 10 - keyframes % 2)
    single = Graph(tmp_path / "c", "falling_objects", **{**given, "seed": 77}).step(10)
    for one in (graph, other, single):
        one.end()
    assert_same_events(graph.events(0), other.events(0))
    assert graph.count("rate_divider", "state_gaps") == 0
    if keyframes == 3:
        assert_same_events(graph.events(1, packets), single.events(0), round(2e9 / 30))


def test_a_bag_keeps_the_own_times(tmp_path):
    """Message for message as they were published."""
    graph = Graph(tmp_path / "a", "falling_objects", envs=2, interpolator="rigid", kept=(WorldState,)).step(3)
    graph.restart([1])
    graph.step(3)
    graph.end()
    with BagReader(graph.bag) as reader:
        found = [message for _, message in reader.messages(["/state"])]
    assert len(found) == len(graph.messages) == 7
    for mine, other in zip(found, graph.messages):
        assert mine.arrays().keys() == other.arrays().keys()
        assert all(np.array_equal(mine.arrays()[n], a) for n, a in other.arrays().items())
    assert found[2].own is None and found[3].own is not None
