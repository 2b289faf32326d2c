"""What the page is told about recordings, labels and what moves, against values worked out by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evis.bag.writer import BagWriter
from evis.runtime.plan import NodePlan, Plan, TopicPlan
from msgs.camera import CameraInfo, EventPacket, Labels
from msgs.header import Header
from msgs.world import WorldState
from nodes.visualizer import catalog
from nodes.visualizer.playback import recording
from nodes.visualizer.views.events import AGES, DENSE, EventView
from nodes.visualizer.views.images import MAX_NAMED, ImageView
from nodes.visualizer.views.tables import MAX_LISTED, BoxView, MovingView, TableView


def plan(tmp_path: Path, target: str, **params: Any) -> Plan:
    """A graph of one source."""
    result = Plan("graph", "run", str(tmp_path))
    result.nodes["source"] = NodePlan("source", target, params, "source")
    return result


CAMERA, REPLAYER = "nodes.camera.node:CameraNode", "nodes.replayer.node:ReplayerNode"


def test_files_are_recordings_and_devices_are_not(tmp_path: Path) -> None:
    played = recording(plan(tmp_path, CAMERA, file="/data/a.raw", again=True))
    assert played == {"node": "source", "file": "a.raw", "again": True, "start": None, "end": None}
    assert recording(plan(tmp_path, CAMERA, serial="1")) is None
    assert recording(plan(tmp_path, CAMERA, file="/data/a.raw", emulate="evk4")) is None
    assert recording(plan(tmp_path, "nodes.physics.node:PhysicsNode", scene="x")) is None


def test_limits_of_a_bag_are_those_of_its_messages(tmp_path: Path) -> None:
    """With the part of it that is played; a bag that cannot be read has none."""
    path = tmp_path / "a.mcap"
    with BagWriter(path) as bag:
        for stamp_ns in (2_000_000_000, 2_500_000_000, 7_250_000_000):
            bag.write("/cam0/events", packet(stamp_ns, np.array([stamp_ns])))
    whole = recording(plan(tmp_path, REPLAYER, bag=str(path), again=True))
    assert whole == {"node": "source", "file": "a.mcap", "again": True, "start": 2.0, "end": 7.25}
    part = recording(plan(tmp_path, REPLAYER, bag=str(path), start=1.0, duration=2.5))
    assert part == {"node": "source", "file": "a.mcap", "again": False, "start": 3.0, "end": 5.5}
    missing = recording(plan(tmp_path, REPLAYER, bag=str(tmp_path / "b.mcap")))
    assert missing == {"node": "source", "file": "b.mcap", "again": False, "start": None, "end": None}


def packet(stamp_ns: int, t: np.ndarray, seq: int = 0) -> EventPacket:
    """Events at these times, each on a pixel of its own."""
    n = len(t)
    x, y = (np.arange(n) % 200).astype(np.uint16), (np.arange(n) // 200).astype(np.uint16)
    offsets, on = np.array([0, n], np.int64), np.ones(n, np.uint8)
    return EventPacket(Header(stamp_ns, seq), offsets, t.astype(np.int64), x, y, on, width=200, height=200)


@pytest.mark.parametrize("n", [100, DENSE + 5000])
def test_ages_are_those_of_the_events(n: int) -> None:
    """Before the newest stamp of a part, to within half a step, over several packets."""
    view = EventView("events", 0)
    rng = np.random.default_rng(1)
    times = [np.sort(rng.integers(k * 10_000_000 + 1, (k + 1) * 10_000_000, n)) for k in range(4)]
    view.capture(packet(10_000_000, times[0]))
    first = view.render(0)
    assert first is not None
    for k in (1, 2, 3):
        view.capture(packet((k + 1) * 10_000_000, times[k], k))
    part = view.render(first.version)
    assert part is not None
    drawn = len(part.payload) // 6
    ages = np.frombuffer(part.payload, "<u2", drawn, 4 * drawn) * (part.meta["oldest"] / AGES)
    expected = (40_000_000 - np.concatenate(times[1:])) / 1e9
    assert drawn == 3 * n
    assert np.abs(ages - expected).max() <= 0.6 * part.meta["oldest"] / AGES + 1e-8  # float32 of 30 ms


def test_events_of_one_time_have_no_age() -> None:
    view = EventView("events", 0)
    view.capture(packet(5, np.full(10, 5)))
    part = view.render(0)
    assert part is not None and part.meta["oldest"] == 0 and not any(part.payload[40:]) and len(part.payload) == 60


def test_only_what_the_labeler_was_told_is_offered(tmp_path: Path) -> None:
    def views(labels: list[str] | None) -> list[str]:
        graph = plan(tmp_path, "nodes.labeler.node:LabelerNode", labels=labels)
        graph.topics["/cam0/labels"] = TopicPlan("/cam0/labels", "Labels", "source", "labels")
        (topic,) = catalog.topics(graph)
        assert topic["asked"] == (labels or []) and topic["sure"]
        return list(topic["views"])

    assert views(["flow", "boxes"]) == ["flow", "objects", "boxes"]
    assert views(["poses"]) == ["objects"]
    assert views(None) == list(catalog.VIEWS["Labels"])


def test_topics_that_a_device_may_lack_are_told(tmp_path: Path) -> None:
    graph = plan(tmp_path, CAMERA, file="a.raw")
    for tail, kind in (("events", "EventPacket"), ("image", "Image"), ("imu", "Imu"), ("info", "CameraInfo")):
        graph.topics[f"/cam0/{tail}"] = TopicPlan(f"/cam0/{tail}", kind, "source", tail)
    assert {t["name"]: t["sure"] for t in catalog.topics(graph)} == {
        "/cam0/events": True, "/cam0/image": False, "/cam0/imu": False, "/cam0/info": True,
    }  # fmt: skip


def test_bodies_that_have_moved_are_remembered_for_an_episode() -> None:
    view = MovingView("moving", 0)

    def state(seq: int, moving: list[int], episode: int = 0) -> WorldState:
        t, n = np.array([0, 1]), len(moving)
        still = np.zeros((1, 3, 7))
        rows = np.zeros((1, 2, n, 7)), np.zeros((1, 2, n, 6))
        header = Header(seq, seq, episode=episode)
        return WorldState(
            header, t, still, np.array(moving, np.int32), *rows, np.zeros(1, np.int32), names=["a", "b", "c"]
        )

    def moved(since: int) -> tuple[int, list[str] | None]:
        part = view.render(since)
        return (since, None) if part is None else (part.version, part.meta["moving"])

    view.capture(state(0, []))
    version, names = moved(0)
    assert names == []
    view.capture(state(1, [2]))
    version, names = moved(version)
    assert names == ["c"]
    view.capture(state(2, [2]))
    assert moved(version) == (version, None)  # no news
    view.capture(state(3, [0]))
    version, names = moved(version)
    assert names == ["a", "c"]
    view.capture(state(4, [1], episode=1))
    assert moved(version)[1] == ["b"]


def test_legend_has_the_largest_and_counts_the_rest() -> None:
    """100 instances: the one with id k has k pixels."""
    ids = np.repeat(np.arange(101), [50, *range(1, 101)]).astype(np.int32).reshape(60, 85)
    view = ImageView("segmentation", 0)
    view.capture(Labels(Header(0), segmentation=ids[None]))
    part = view.render(0)
    assert part is not None
    found = part.meta["instances"]
    assert [i for i, _ in found["shown"]] == list(range(101 - MAX_NAMED, 101)) and found["more"] == 100 - MAX_NAMED


def test_all_boxes_come() -> None:
    """More than a table has rows."""
    n = 700
    box = np.tile(np.array([1, 2, 3, 4], np.float32), (n, 1))
    view = BoxView("boxes", 0)
    view.capture(Labels(Header(0), box=box, box_env=np.zeros(n, np.int32), box_id=np.arange(1, n + 1, dtype=np.int32)))
    part = view.render(0)
    assert part is not None and [b[0] for b in part.meta["boxes"]] == list(range(1, n + 1))


def test_camera_tells_what_its_instances_are() -> None:
    names = ["background", *(f"n{k}" for k in range(MAX_LISTED + 30))]
    semantic = np.arange(len(names), dtype=np.int32) % 3
    info = CameraInfo(Header(0), np.eye(3), np.empty(0), instances=names, semantic=semantic, classes=["a", "b", "c"])
    view = TableView("camera", 0)
    view.capture(info)
    part = view.render(0)
    assert part is not None
    assert part.meta["names"] == names and part.meta["semantic"] == semantic.tolist()
    assert [name for name, _ in part.meta["classes"]] == ["a", "b", "c"]
    (row,) = [r for r in part.meta["tables"][0]["rows"] if r[0] == "instances"]
    assert row[1].endswith(f"n{MAX_LISTED - 2} ... and 31 more")
