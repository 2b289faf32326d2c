"""`evis.open` on bags: cameras and environments to choose from, and the messages of every topic."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import evis
from evis.bag.writer import BagWriter
from evis.events import RecordingError
from msgs.camera import EventPacket, Image, Imu, Labels
from msgs.header import Header

STEP = 10_000_000


def packet(k: int, envs: int, camera: int) -> EventPacket:
    """Events of step k: environment e of camera c has k + e + c of them."""
    sizes = [k + e + camera for e in range(envs)]
    t = np.concatenate([(k - 1) * STEP + 1 + np.arange(size, dtype=np.int64) * 1000 for size in sizes])
    x = np.full(len(t), 10 * camera, np.uint16)
    offsets = np.cumsum([0, *sizes])
    y = np.repeat(np.arange(envs), sizes).astype(np.uint16)
    columns = {"t": t, "x": x, "y": y, "p": np.ones(len(t), np.uint8)}
    return EventPacket(Header(k * STEP, k), offsets, **columns, width=32, height=24, t0_ns=(k - 1) * STEP)


def bag(path: Path, envs: int = 1, events: bool = True) -> Path:
    """Four steps of two cameras, with images, labels and inertial samples of the first."""
    with BagWriter(path) as writer:
        for k in range(1, 5):
            h, stamp = Header(k * STEP, k), np.array([k * STEP])
            if events:
                writer.write("/cam0/events", packet(k, envs, 0))
                writer.write("/cam1/events", packet(k, envs, 1))
            writer.write("/cam0/image", Image(h, np.full((24, 32, 3), k, np.uint8)))
            writer.write("/cam0/labels", Labels(h, flow=np.full((envs, 24, 32, 2), k, np.float32)))
            writer.write("/cam0/imu", Imu(h, stamp, np.full((1, 3), 1.0 * k), np.zeros((1, 3))))
    return path


def test_cameras_are_chosen_by_topic(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap")
    rec = evis.open(path)
    assert rec.topics == {
        "/cam0/events": "EventPacket",
        "/cam0/image": "Image",
        "/cam0/imu": "Imu",
        "/cam0/labels": "Labels",
        "/cam1/events": "EventPacket",
    }
    assert [len(p) for p in rec] == [1, 2, 3, 4]
    other = evis.open(path, "/cam1/events")
    assert [len(p) for p in other] == [2, 3, 4, 5] and set(other.numpy()["x"]) == {10}
    assert (other.width, other.height) == (32, 24)
    assert [len(w) for w in other[STEP : 3 * STEP].windows(STEP)] == [3, 4]


def test_environments_are_chosen_by_topic(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap", envs=3)
    rec = evis.open(path, "/env2/cam1/events")
    assert [len(p) for p in rec] == [4, 5, 6, 7] and set(rec.numpy()["y"]) == {2}
    assert {"/env0/cam0/events", "/env2/cam1/events", "/cam0/events", "/cam0/labels"} <= rec.topics.keys()
    assert [m.flow.shape[0] for m in rec.messages("/cam0/labels") if isinstance(m, Labels)] == [3] * 4
    for topic in rec.topics:
        assert len(list(rec.messages(topic))) == 4, topic
    alone = [m for m in rec[STEP : 3 * STEP].messages("/env2/cam1/events") if isinstance(m, EventPacket)]
    assert [(len(m.t), m.env_offsets.tolist(), set(m.y)) for m in alone] == [(4, [0, 4], {2}), (5, [0, 5], {2})]
    with pytest.raises(RecordingError, match="no topic '/env3/cam1/events'"):
        list(rec.messages("/env3/cam1/events"))


def test_messages_of_every_topic(tmp_path: Path) -> None:
    rec = evis.open(bag(tmp_path / "a.mcap"))
    assert [int(m.data[0, 0, 0]) for m in rec.messages("/cam0/image") if isinstance(m, Image)] == [1, 2, 3, 4]
    assert [m.acceleration[0, 0] for m in rec.messages("/cam0/imu") if isinstance(m, Imu)] == [1, 2, 3, 4]
    cut = rec[2 * STEP : 4 * STEP]
    assert [m.header.stamp_ns for m in cut.messages("/cam0/labels")] == [2 * STEP, 3 * STEP]
    with pytest.raises(RecordingError, match="no topic '/cam0/label'; it has /cam0/events"):
        list(rec.messages("/cam0/label"))


def test_a_bag_without_events_has_messages(tmp_path: Path) -> None:
    rec = evis.open(bag(tmp_path / "a.mcap", events=False))
    assert "/cam0/imu" in rec.topics and len(list(rec.messages("/cam0/imu"))) == 4
    with pytest.raises(RecordingError, match="a bag without events; its topics are"):
        rec.read()


def test_an_unknown_camera_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no events on '/cam7/events'; they are on /cam0/events, /cam1/events"):
        evis.open(bag(tmp_path / "a.mcap"), "/cam7/events")


def test_a_torn_bag_says_so(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes()[:-40])
    rec = evis.open(path)
    assert rec.counts.events == 10 and rec.info.truncated and "torn" in rec.info.warnings[-1]


@pytest.mark.parametrize("lengths", [(500, 500), (500, 120, 300), (300, 100)])
def test_the_durations_of_episodes_add_up(tmp_path: Path, lengths: tuple[int, ...]) -> None:
    """The last one ends earlier than the first: from its first event to its last a recording had too little time, or
    less than none."""
    begin, k = 150 * STEP // 10, 0
    with BagWriter(tmp_path / "run.mcap") as writer:
        for episode, length in enumerate(lengths):
            start = 0 if episode else begin
            for at in (0, length // 2, length):
                k += 1
                t, one = np.array([start + at * STEP // 10]), np.ones(1, np.uint16)
                columns = {"t": t, "x": one, "y": one, "p": one.astype(np.uint8)}
                header = Header(int(t[0]) + 1, k, episode=episode)
                writer.write("/cam0/events", EventPacket(header, np.array([0, 1]), **columns, width=32, height=24))
    recording = evis.open(tmp_path / "run.mcap")
    assert recording.counts.events == 3 * len(lengths)
    assert recording.duration_ns == recording.counts.duration_ns == sum(lengths) * STEP // 10
    assert (recording.start_ns, recording.end_ns) == (begin, lengths[-1] * STEP // 10)


def test_a_slice_without_an_end_has_its_part_of_every_episode(tmp_path: Path) -> None:
    """Not what later episodes have before its start; what is out of order by less than an episode is stays."""
    with BagWriter(tmp_path / "run.mcap") as writer:
        for k in range(1, 61):
            episode, i = divmod(k - 1, 20)
            t = i * STEP + np.array([0, 2000, 1000])
            columns = {"t": t, "x": np.zeros(3, np.uint16), "y": np.zeros(3, np.uint16), "p": np.ones(3, np.uint8)}
            header = Header((i + 1) * STEP, k, episode=episode)
            writer.write("/cam0/events", EventPacket(header, np.array([0, 3]), **columns, width=32, height=24))
    begin = 15 * STEP + 1500
    t = evis.open(tmp_path / "run.mcap")[begin:].numpy()["t"]
    whole = np.concatenate([i * STEP + np.array([0, 2000, 1000]) for i in range(16, 20)])
    # The first episode is read from its first event on that is not earlier, in the order of the file.
    expected = [[15 * STEP + 2000, 15 * STEP + 1000], whole, [15 * STEP + 2000], whole, [15 * STEP + 2000], whole]
    assert t.tolist() == np.concatenate(expected).tolist()
