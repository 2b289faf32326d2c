"""The camera node on recordings: everything arrives once, in order, with the device's own times."""

from __future__ import annotations

import hashlib
import itertools
import json

import numpy as np
import pytest
from camera_rig import DATA, Runtime, joined, play, write

from evis.bag.writer import BagWriter
from evis.config.params import ParamError
from msgs.camera import EventPacket
from msgs.header import Header

REAL = ["derived/gen31_vga_from_bag1.raw", "prophesee/faery_evt2.raw"]
MS = 1_000_000


def real(name: str):
    if not (DATA / name).exists():
        pytest.skip(f"no recording {DATA / name} (set EVIS_TEST_DATA)")
    return DATA / name, json.loads((DATA / "ground_truth.json").read_text())["files"][name]


@pytest.mark.parametrize("packet_ms", [1.0, 10.0, 333.3])
@pytest.mark.parametrize("name", REAL)
def test_real_recording_arrives_whole(name, packet_ms):
    """All events of the file, to the last, with the hash that other readers found; packets tile the time."""
    path, known = real(name)
    runtime = play(Runtime(), file=str(path), pace="fast", packet_ms=packet_ms)
    packets = runtime.messages["events"]
    events = joined(packets)
    digest = hashlib.sha256()
    for array in (events.t // 1000, events.x, events.y, events.p):
        digest.update(array.tobytes())
    assert digest.hexdigest() == known["sha256"]
    step = round(packet_ms * MS)
    for before, after in itertools.pairwise(packets):
        assert after.t0_ns == before.header.stamp_ns
    for packet in packets:
        assert packet.header.stamp_ns - packet.t0_ns == step
        assert packet.header.stamp_ns % step == 0
        assert packet.env_offsets.tolist() == [0, len(packet.t)]
        assert ((packet.t > packet.t0_ns) & (packet.t <= packet.header.stamp_ns)).all()
    assert not runtime.counters and not runtime.warnings


def test_clock_info_and_triggers_of_the_real_camera():
    """The serial number names the clock, the info says who the camera is, triggers come with the packets' stamps."""
    path, _ = real(REAL[0])
    known = json.loads((DATA / "ground_truth.json").read_text())["files"]["ros/event_camera_py_test_events_1.bag"]
    runtime = play(Runtime("events", "info", "trigger"), file=str(path), pace="fast", camera="dvs")
    (info,) = runtime.messages["info"]
    assert (info.name, info.width, info.height, info.clock) == ("dvs", 640, 480, "device:0293")
    assert info.header.stamp_ns == runtime.messages["events"][0].t0_ns
    assert (info.sensor["serial"], info.sensor["sensor"], info.sensor["encoding"]) == ("0293", "Gen3.1", "evt3")
    triggers, packets = runtime.messages["trigger"], runtime.messages["events"]
    assert [m.header.stamp_ns for m in triggers] == [m.header.stamp_ns for m in packets]
    assert {m.header.clock for m in packets + triggers} == {"device:0293"}
    t = np.concatenate([m.t for m in triggers])
    assert (len(t), int((t // 1000).sum())) == (known["n_triggers"], known["sum_t_triggers"])


def test_a_recording_plays_again_as_further_episodes(tmp_path, monkeypatch):
    """Every round has the same packets; without `again` there is one."""
    monkeypatch.setattr("nodes.camera.node.REST_S", 0.0)
    path = write(tmp_path / "a.npz", [1 * MS, 12 * MS, 27 * MS])
    once = play(Runtime(), file=str(path), pace="fast").messages["events"]
    runtime = Runtime()
    with pytest.raises(AssertionError, match="does not end"):
        play(runtime, max_steps=200, file=str(path), pace="fast", again=True)
    rounds = {}
    for packet in runtime.messages["events"]:
        rounds.setdefault(packet.header.episode, []).append(packet)
    assert len(rounds) > 5 and sorted(rounds) == list(range(len(rounds)))
    assert [m.header.episode for m in runtime.messages["info"]][: len(rounds)] == list(range(len(rounds)))
    for episode in range(len(rounds) - 1):
        assert [p.header.stamp_ns for p in rounds[episode]] == [p.header.stamp_ns for p in once]
        assert joined(rounds[episode]).t.tolist() == joined(once).t.tolist() == [1 * MS, 12 * MS, 27 * MS]


@pytest.mark.parametrize("name", REAL)
def test_raw_bytes_are_the_file(name):
    """With raw, the packets together carry every byte behind the file's header."""
    path, _ = real(name)
    runtime = play(Runtime(), file=str(path), pace="fast", raw=True)
    packets = runtime.messages["events"]
    assert {p.encoding for p in packets} == {"evt3" if "gen31" in name else "evt2"}
    data = path.read_bytes()
    wire = b"".join(p.raw.tobytes() for p in packets)
    assert data.endswith(wire) and b"% " in data[: len(data) - len(wire)][-20:]


def test_without_raw_there_is_no_encoding(tmp_path):
    """The encoding names the wire bytes; packets without them have none."""
    runtime = play(Runtime(), file=str(write(tmp_path / "a.raw", [1 * MS])), pace="fast")
    (packet,) = runtime.messages["events"]
    assert (packet.raw, packet.encoding, packet.header.clock) == (None, "", "device:a.raw")


@pytest.mark.parametrize("suffix", [".raw", ".npz"])
def test_boundaries(suffix, tmp_path):
    """An event on a boundary belongs to the packet that ends there; silent intervals are empty packets."""
    t = [10 * MS, 10 * MS + 1000, 20 * MS, 45 * MS]
    runtime = play(Runtime(), file=str(write(tmp_path / f"a{suffix}", t)), pace="fast")
    packets = runtime.messages["events"]
    assert [(p.t0_ns // MS, p.header.stamp_ns // MS, len(p.t)) for p in packets] == [
        (0, 10, 1),
        (10, 20, 2),
        (20, 30, 0),
        (30, 40, 0),
        (40, 50, 1),
    ]


def test_steps_back_stay_in_their_place_and_are_counted(tmp_path):
    """Real order and times are kept; events before their packet's interval are reported."""
    t = np.array([9, 12, 8, 13, 25]) * MS
    runtime = play(Runtime(), file=str(write(tmp_path / "a.npz", t)), pace="fast")
    assert joined(runtime.messages["events"]).t.tolist() == t.tolist()
    assert runtime.counters == {"events_stepped_back": 1}


def test_a_clock_that_was_set_back_is_told(tmp_path):
    """All that follows up to where the times were is one packet, of which nothing but a count of events told."""
    t = np.concatenate([np.arange(1, 3001), np.arange(1, 3003)]) * MS
    runtime = play(Runtime(), file=str(write(tmp_path / "a.npz", t)), pace="fast")
    packets = runtime.messages["events"]
    assert joined(packets).t.tolist() == t.tolist() and max(len(p.t) for p in packets) == 3010
    assert runtime.counters["clock_set_back"] == 1
    assert [text for text in runtime.warnings if "go back by far" in text] == runtime.warnings


def test_a_jump_of_the_device_clock_is_no_flood(tmp_path):
    """Years of silence in a file are one empty packet, counted."""
    t = [5 * MS, 10**17, 10**17 + 3 * MS]
    runtime = play(Runtime(), max_steps=20, file=str(write(tmp_path / "a.npz", t)), pace="fast")
    packets = runtime.messages["events"]
    assert [len(p.t) for p in packets] == [1, 0, 1, 1]
    assert packets[1].header.stamp_ns == 10**17 - 10 * MS
    assert runtime.counters == {"long_gaps": 1}


def test_duration_is_device_time(tmp_path):
    """Playing stops so long after the first event, wherever packets begin, as an emulated device does."""
    path = str(write(tmp_path / "a.raw", np.arange(7, 100) * MS))
    for packet_ms in 10.0, 1000.0:
        for device in {}, {"emulate": "evk4"}:
            given = {"file": path, "pace": "fast", "duration": 0.025, "packet_ms": packet_ms} | device
            packets = play(Runtime(), **given).messages["events"]
            assert joined(packets).t.tolist() == [k * MS for k in range(7, 32)]
    packets = play(Runtime(), file=path, pace="fast", duration=0.025).messages["events"]
    assert [p.header.stamp_ns for p in packets] == [10 * MS, 20 * MS, 30 * MS, 32 * MS - 1]


def test_warnings_and_drops_are_passed_on(tmp_path):
    """A cut file and events outside the sensor are said on /diagnostics and counted."""
    path = write(tmp_path / "a.raw", [MS, 2 * MS, 3 * MS])
    data = path.read_bytes().replace(b"48;width=64", b"2;width=64").replace(b"64x48", b"64x2")
    path.write_bytes(data + b"\x07")
    runtime = play(Runtime(), file=str(path), pace="fast")
    assert [len(p.t) for p in runtime.messages["events"]] == [2]
    assert runtime.counters == {"events_outside": 1}
    assert "cut inside a word" in runtime.warnings[0]


def test_a_file_without_events_ends_at_once(tmp_path):
    """The info is published, then the node is done."""
    with_header = write(tmp_path / "a.raw", [MS])
    with_header.write_bytes(with_header.read_bytes().split(b"% end\n")[0] + b"% end\n")
    runtime = play(Runtime(), file=str(with_header), pace="fast")
    assert list(runtime.messages) == ["info"]
    assert runtime.warnings == ["no data after the header"]


@pytest.mark.parametrize(
    ("params", "error", "text"),
    [
        ({}, OSError, "no event camera found.*file:="),
        ({"serial": "123"}, OSError, "no camera 123 found"),
        ({"file": "a", "emulate": "b.raw"}, ValueError, "file and emulate are given"),
        ({"file": "a", "emulate": "evk44"}, ValueError, "no camera model 'evk44'; did you mean 'evk4'"),
        ({"file": "/nonexistent/a.raw"}, ValueError, "no such file"),
        ({"file": "a.raw", "pace": "slow"}, ParamError, "pace is 'slow', must be realtime, fast"),
        ({"file": "a.raw", "pace": "-1"}, ParamError, "pace is '-1'"),
        ({"file": "a.raw", "packet_ms": 0}, ParamError, "packet_ms is 0"),
        ({"flie": "a.raw"}, ParamError, "did you mean 'file'"),
    ],
)
def test_wrong_use_is_named(params, error, text, no_camera):
    """One line with the parameter and the remedy."""
    with pytest.raises(error, match=text) as caught:
        play(Runtime(), **params)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("emulate", [None, "davis346"])
def test_the_topic_of_a_bag_with_several_is_chosen(emulate, tmp_path):
    """The right camera's events are those at its pixel; a topic that is not there is named with those that are."""
    path = tmp_path / "stereo.mcap"
    with BagWriter(path) as writer:
        for k, camera in enumerate(("cam0", "cam1")):
            t, at = np.array([2 * MS, 3 * MS]), np.full(2, 10 * (k + 1), np.uint16)
            packet = EventPacket(Header(4 * MS), np.array([0, 2]), t, at, at, np.ones(2, np.uint8))
            packet.width, packet.height = 346, 260
            writer.write(f"/{camera}/events", packet)
    for topic, pixel in (("/cam1/events", 20), ("", 10)):
        runtime = play(Runtime(), file=str(path), emulate=emulate, pace="fast", topic=topic)
        assert joined(runtime.messages["events"]).x.tolist() == [pixel, pixel]
    with pytest.raises(ValueError, match=r"/cam2/events.*/cam1/events"):
        play(Runtime(), file=str(path), emulate=emulate, pace="fast", topic="/cam2/events")
