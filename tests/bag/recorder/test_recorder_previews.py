"""Previews are due at their rate, whatever the keyframes', and keyframes between them are not brought to the host."""

import numpy as np
import pytest
import warp as wp
from hand_driven_nodes import make_node

from evis.bag.reader import BagReader
from evis.runtime.pacing import RateLimit
from msgs.camera import Image, Keyframe
from msgs.header import Header
from nodes.recorder.node import RecorderNode

MS = 1_000_000


@pytest.mark.parametrize(
    ("rate_hz", "period_ms", "due"),
    [
        (10.0, 100, [0, 1, 2, 3]),
        (10.0, 33, [0, 4, 7, 10]),  # 0, 132, 231, 330 ms: the first at or after every multiple of 100 ms
        (10.0, 250, [0, 1, 2, 3]),
        (1000.0, 33, [0, 1, 2]),
    ],
)
def test_a_preview_is_due_at_the_first_keyframe_of_every_period(rate_hz, period_ms, due):
    clock = RateLimit(rate_hz)
    taken = [k for k in range(due[-1] + 1) if clock.takes(Header((7 + k * period_ms) * MS))]
    assert taken == due


def test_another_episode_begins_with_one():
    clock = RateLimit(10.0)
    assert clock.takes(Header(0)) and not clock.takes(Header(50 * MS))
    assert clock.takes(Header(60 * MS, episode=1)) and not clock.takes(Header(100 * MS, episode=1))


def test_it_need_not_be_asked_about_what_is_not_due():
    """As a recorder's thread does not hear of keyframes that stayed on their device."""
    stamps = [7 * k * MS for k in range(200)]
    all_asked, some_asked = RateLimit(10.0), RateLimit(10.0)
    due = [s for s in stamps if all_asked.takes(Header(s))]
    assert due == [s for s in due if some_asked.takes(Header(s))]


def keyframe(k):
    image = np.full((1, 6, 8, 3), 0.1 * (k + 1), np.float32)
    return Keyframe(Header(33 * k * MS, k), np.zeros(1, np.int32), radiance=image)


def left_on_its_device(k):
    image = wp.array(keyframe(k).radiance, dtype=wp.vec3, device="cpu")
    return Keyframe(Header(33 * k * MS, k), np.zeros(1, np.int32), radiance=image)


def test_a_recorder_asks_for_the_keyframes_that_are_due(tmp_path):
    """Those that lie on a device and are not due are noticed and nothing more."""
    path = tmp_path / "a.mcap"
    node = make_node(RecorderNode, path=str(path))
    node.runtime.plan.topics = dict.fromkeys(["/cam0/keyframe", "/cam0/events"])
    node.setup()
    asked, due = [], RateLimit(node.arrays_hz(node.params, "/cam0/keyframe"))
    for k in range(12):
        asked.append(due.takes(Header(33 * k * MS, k)))
        node.receive("/cam0/keyframe", keyframe(k) if asked[-1] else left_on_its_device(k))
    assert [k for k, yes in enumerate(asked) if yes] == [0, 4, 7, 10]
    assert node.arrays_hz(node.params, "/cam0/events") is None
    node.finish()
    node.close()
    with BagReader(path) as bag:
        images = [m for _, m in bag.messages() if isinstance(m, Image)]
        assert [m.header.stamp_ns for m in images] == [0, 132 * MS, 231 * MS, 330 * MS]
    assert not node.recorder.counters["lost"]


def without_arrays(k):
    return Keyframe(Header(33 * k * MS, k), np.zeros(0, np.int32), radiance=np.zeros((0, 6, 8, 3), np.float32))


def test_keyframes_that_come_without_arrays_from_another_process_are_noticed(tmp_path):
    path = tmp_path / "a.mcap"
    node = make_node(RecorderNode, path=str(path))
    node.runtime.plan.topics = dict.fromkeys(["/cam0/keyframe"])
    node.setup()
    due = RateLimit(node.arrays_hz(node.params, "/cam0/keyframe"))
    for k in range(12):
        node.receive("/cam0/keyframe", keyframe(k) if due.takes(Header(33 * k * MS, k)) else without_arrays(k))
    node.finish()
    node.close()
    with BagReader(path) as bag:
        images = [m for _, m in bag.messages() if isinstance(m, Image)]
        assert [m.header.stamp_ns for m in images] == [0, 132 * MS, 231 * MS, 330 * MS]
    assert not node.recorder.counters["lost"]


def test_a_recorded_keyframe_is_read_each_time():
    assert RecorderNode.arrays_hz({"topics": ["/cam0/keyframe"]}, "/cam0/keyframe") is None
    assert RecorderNode.arrays_hz({"preview_hz": 0}, "/cam0/keyframe") is None  # it has none to read then
