"""The camera node on emulated USB devices, the simulator behind one, and `evis camera` with them."""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys

import numpy as np
import pytest
from camera_rig import Runtime, play, write
from camera_rig import joined as all_events
from usb_rig import DATA, random_recording, same

import evis
from evis.cli import main
from evis.cli.machine import camera
from evis.events import Events, open_recording
from msgs.camera import EventPacket
from msgs.header import Header
from nodes.camera.emulated.live import EmulatedCameraNode
from nodes.camera.find import open_emulated
from nodes.camera.usb.models import MODELS

MS = 1_000_000
FAST = {"pace": "fast", "settings": ["decoder=numpy"]}


def test_node_publishes_the_stream(tmp_path):
    """Events, a trigger message per packet, and who the camera is; the clock is named everywhere."""
    sent = random_recording(tmp_path / "a.raw", 640, 480)
    runtime = play(Runtime("events", "info", "trigger"), emulate="silkyevcam", file=str(tmp_path / "a.raw"), **FAST)
    packets = runtime.messages["events"]
    assert same(all_events(packets), sent)
    (info,) = runtime.messages["info"]
    assert (info.width, info.height, info.sensor["firmware"]) == (640, 480, "3.9.0")
    stamps = [m.header.stamp_ns for m in packets]
    assert [m.header.stamp_ns for m in runtime.messages["trigger"]] == stamps
    assert {m.header.clock for m in [*packets, info]} == {"device:0000e915"}
    assert not runtime.counters and not runtime.warnings


def test_node_publishes_frames_and_samples():
    """DAVIS: an Imu message per packet, an Image per frame at the middle of its exposure."""
    path = DATA / "aedat4" / "aestream_davis.aedat4"
    if not path.exists():
        pytest.skip(f"no recording {path} (set EVIS_TEST_DATA)")
    runtime = play(Runtime("events", "imu", "image"), emulate="davis346", file=str(path), **FAST)
    with open_recording(path) as recording:
        sent = recording.read()
    images = runtime.messages["image"]
    assert [m.header.stamp_ns for m in images] == [(f.exposure_start_ns + f.exposure_end_ns) // 2 for f in sent.frames]
    assert {(m.encoding, m.data.shape) for m in images} == {("mono16", (260, 346, 1))}
    assert np.concatenate([m.t for m in runtime.messages["imu"]]).tolist() == sent.imu.t.tolist()


def test_node_reconnects_in_a_new_episode(tmp_path):
    """Unplugged and plugged in again: a warning, a new episode, the stream goes on."""
    random_recording(tmp_path / "a.npz", 346, 260)
    runtime = play(
        Runtime(), emulate="davis346", file=str(tmp_path / "a.npz"), reconnect=True,
        faults="short=1024,unplug_after=20000,replug", **FAST,
    )  # fmt: skip
    assert {m.header.episode for m in runtime.messages["events"]} == {0, 1}
    assert runtime.counters["unplugged"] == runtime.counters["reconnected"] == 1
    assert any("unplugged" in w for w in runtime.warnings) and any("is back" in w for w in runtime.warnings)
    infos = [(m.header.episode, m.header.stamp_ns) for m in runtime.messages["info"]]
    assert [episode for episode, _ in infos] == [0, 1] and infos[1][1] == 0  # its clock starts anew


def test_a_round_with_a_camera_that_was_plugged_in_again(tmp_path, monkeypatch):
    """Each connection of each round is an episode: the second round began with the last episode of the first, whose
    times it repeated, and said that the camera was back."""
    monkeypatch.setattr("nodes.camera.node.REST_S", 0.0)
    random_recording(tmp_path / "a.npz", 346, 260)
    runtime = Runtime()
    with pytest.raises(AssertionError, match="does not end"):
        play(
            runtime, max_steps=400, emulate="davis346", file=str(tmp_path / "a.npz"), reconnect=True, again=True,
            faults="short=1024,unplug_after=20000,replug", **FAST,
        )  # fmt: skip
    packets = runtime.messages["events"]
    last = packets[-1].header.episode
    assert last >= 4  # episodes 0 and 1 are the first round
    of_episode = {e: [(m.t0_ns, len(m.t)) for m in packets if m.header.episode == e] for e in range(last)}
    assert all(of_episode[e] == of_episode[e % 2] for e in range(last)) and of_episode[0] != of_episode[1]
    assert all(a.header.episode <= b.header.episode for a, b in itertools.pairwise(packets))
    back = [int(text.split("episode ")[1].rstrip(")")) for text in runtime.warnings if "is back" in text]
    assert back == list(range(1, back[-1] + 1, 2))
    assert sorted({m.header.episode for m in runtime.messages["info"]}) == list(range(last + 1))


def test_a_recording_of_today_goes_on_near_its_own_time(tmp_path):
    """From 0 to the next event of an emulated camera that is back would be 50 years, in the summary and on the page."""
    first = 1_633_953_690_000_000_000
    write(tmp_path / "a.npz", first + np.arange(20_000) * 50_000)
    runtime = play(
        Runtime(), emulate="davis346", file=str(tmp_path / "a.npz"), reconnect=True,
        faults="short=1024,unplug_after=20000,replug", **FAST,
    )  # fmt: skip
    assert runtime.counters["reconnected"] == 1
    stamps = [m.header.stamp_ns for port in ("info", "events") for m in runtime.messages[port]]
    assert first - 10**7 <= min(stamps) and max(stamps) <= first + 10**9 + 10**7


@pytest.mark.parametrize("replugged", [False, True])
def test_a_duration_is_that_of_all_connections(tmp_path, monkeypatch, replugged):
    """After the camera was plugged in again its clock starts anew, and the duration did so too."""
    random_recording(tmp_path / "a.npz", 346, 260)
    faults = "short=1024,unplug_after=20000,replug" if replugged else ""
    given = {"emulate": "davis346", "file": str(tmp_path / "a.npz"), "reconnect": True, "packet_ms": 1.0, **FAST}
    whole = play(Runtime(), **given, faults=faults).messages["events"]
    spans = {e: [(m.t0_ns, m.header.stamp_ns) for m in whole if m.header.episode == e] for e in range(1 + replugged)}
    of_first = spans[0][-1][1] - spans[0][0][0]
    into_last = (spans[replugged][-1][1] - spans[replugged][0][0]) // 2
    duration = into_last + (of_first if replugged else 0)
    monkeypatch.setattr(
        "nodes.camera.find.find_driver", lambda *_, **__: open_emulated("davis346", given["file"], 0.0, 0.0, faults)
    )
    device = {name: given[name] for name in ("reconnect", "packet_ms", "settings")}
    part = play(Runtime(), **device, duration=duration / 1e9).messages["events"]
    taken = {e: [(m.t0_ns, m.header.stamp_ns) for m in part if m.header.episode == e] for e in spans}
    assert all(taken[e] == spans[e] for e in range(replugged))
    last, begun = taken[replugged], spans[replugged][0][0]
    assert last == spans[replugged][: len(last)] and last[-1][1] - begun >= into_last > last[-2][1] - begun


def test_descriptions_have_the_time_of_what_they_say(tmp_path, monkeypatch):
    """Temperature and drift are asked for now and then: each description is stamped as the packet before it."""
    monkeypatch.setattr("nodes.camera.node.STATUS_S", 0.0)
    monkeypatch.setattr("nodes.camera.node.COUNT_S", 0.0)
    random_recording(tmp_path / "a.raw", 640, 480)
    runtime = play(Runtime(), emulate="silkyevcam", file=str(tmp_path / "a.raw"), **FAST)
    stamps = [m.header.stamp_ns for m in runtime.messages["info"]]
    packets = [m.header.stamp_ns for m in runtime.messages["events"]]
    assert stamps[0] <= packets[0] and stamps == sorted(stamps)
    assert set(packets) <= set(stamps)


def simulated(episode: int, seed: int, width: int, height: int) -> list[EventPacket]:
    """Packets as the event sensor publishes them: sorted, ns, in (t0, stamp]; the first is empty."""
    rng, packets = np.random.default_rng(seed), []
    for k in range(12):
        stamp, t0 = round(k * 1e9 / 30), round(max(k - 1, 0) * 1e9 / 30)
        n = 0 if k in (0, 5) else int(rng.integers(1, 3000))
        t = np.sort(rng.integers(t0 + 1, stamp + 1, n)) if n else np.empty(0, np.int64)
        x, y = rng.integers(0, width, n, np.uint16), rng.integers(0, height, n, np.uint16)
        p = rng.integers(0, 2, n, np.uint8)
        packets.append(
            EventPacket(
                Header(stamp, episode=episode), np.array([0, n]), t, x, y, p, width=width, height=height, t0_ns=t0
            )
        )
    return packets


@pytest.mark.parametrize("name", [n for n in MODELS if MODELS[n].encoding != "dvxplorer_mini"])
def test_simulator_behind_a_usb_camera(name):
    """sim -> encoder -> emulated device -> driver: the simulator's events, times cut to whole us, over a reset too."""
    model = MODELS[name]
    node = EmulatedCameraNode("usb", {"emulate": name})
    node.runtime = runtime = Runtime()  # type: ignore[assignment]
    node.setup()
    sent = simulated(0, 1, model.width, model.height) + simulated(1, 2, model.width, model.height)
    try:
        for packet in sent:
            node.update({"simulated": packet})
    finally:
        node.close()
    got = runtime.messages["events"]
    assert [(m.header.stamp_ns, m.t0_ns, m.header.episode) for m in got] == [
        (m.header.stamp_ns, m.t0_ns, m.header.episode) for m in sent
    ]
    for a, b in zip(sent, got):
        assert same(Events(a.t // 1000 * 1000, a.x, a.y, a.p), Events(b.t, b.x, b.y, b.p))
    # the first us of an interval that begins inside a us is no step back
    assert "events_stepped_back" not in runtime.counters


def test_simulator_behind_a_mini():
    """All events; of one us and column the order may change, and a us that two packets share is moved by 1 us."""
    node = EmulatedCameraNode("usb", {"emulate": "dvxplorer_mini"})
    node.runtime = runtime = Runtime()  # type: ignore[assignment]
    node.setup()
    sent = simulated(0, 1, 640, 480)
    try:
        for packet in sent:
            node.update({"simulated": packet})
    finally:
        node.close()
    got = runtime.messages["events"]
    for a, b in zip(sent, got):
        late = b.t - np.sort(a.t // 1000 * 1000)
        assert len(a.t) == len(b.t) and ((late == 0) | (late == 1000)).all()
        key = lambda m: np.sort(m.x.astype(np.int64) << 12 | m.y.astype(np.int64) << 1 | m.p)
        assert (key(a) == key(b)).all()


def test_counts_of_a_mini_go_on_over_a_reset():
    """Of what is moved by 1 us: two packets that share a us, in each of three episodes."""
    node = EmulatedCameraNode("usb", {"emulate": "dvxplorer_mini"})
    node.runtime = runtime = Runtime()  # type: ignore[assignment]
    node.setup()
    pixels = np.arange(3, dtype=np.uint16)
    try:
        for episode, late in enumerate((3, 1, 2)):
            for k, n in ((1, 1), (2, late)):
                header = Header(k * 1500, episode=episode)
                columns = np.full(n, 1400 if k == 1 else 1600), pixels[:n], pixels[:n], np.ones(n, np.uint8)
                packet = EventPacket(header, np.array([0, n]), *columns, width=640, height=480, t0_ns=(k - 1) * 1500)
                node.update({"simulated": packet})
    finally:
        node.close()
    assert runtime.counters["events_delayed_us"] == 3 + 1 + 2


def test_simulator_that_does_not_fit():
    """Larger than the camera, or several worlds: one line with the remedy."""
    node = EmulatedCameraNode("usb", {"emulate": "dvs128"})
    node.runtime = Runtime()  # type: ignore[assignment]
    node.setup()
    packet = simulated(0, 1, 346, 260)[1]
    try:
        with pytest.raises(ValueError, match=r"346x260 px do not fit on the iniVation DVS128 \(128x128\)"):
            node.update({"simulated": packet})
        packet.env_offsets = np.array([0, 1, len(packet.t)])
        with pytest.raises(ValueError, match="one world, not 2"):
            node.update({"simulated": packet})
    finally:
        node.close()


def call(capsys, *arguments: str) -> str:
    parser = argparse.ArgumentParser()
    camera.add_arguments(parser)
    assert camera.run(parser.parse_args(arguments)) == 0
    return capsys.readouterr().out


def test_command_on_emulated_cameras(capsys, tmp_path):
    """info, its settings, stream with faults and a setting, udev."""
    about = json.loads(call(capsys, "info", "--emulate", "evk4", "--settings", "--json"))
    assert (about["name"], about["width"], about["settings"]["bias_fo"]["maximum"]) == ("evk4", 1280, 55)
    assert "background_filter_us" in call(capsys, "info", "--emulate", "davis346", "--settings")
    of_a_mini = call(capsys, "info", "--emulate", "dvxplorer_mini", "--settings").splitlines()
    fixed = [line.split("=")[0].strip() for line in of_a_mini if "decided at the start" in line]
    assert fixed[-2:] == ["imu", "binning"] and "packet_ms" in fixed and "sensitivity" not in fixed
    random_recording(tmp_path / "a.raw", 640, 480)
    arguments = ["stream", "--emulate", "silkyevcam", "--file", str(tmp_path / "a.raw"), "--pace", "fast"]
    arguments += ["--set", "decoder=numpy", "--set", "bias_fo=1500", "--json"]
    assert json.loads(call(capsys, *arguments))["events"] == 20_000
    stalled = json.loads(call(capsys, *arguments, "--faults", "short=512,stall_every=9"))
    assert stalled["stalls"] > 0 and stalled["gaps"] > 0
    assert "31f7" in call(capsys, "udev")


def test_wrong_use_of_the_command(capsys, tmp_path):
    """One line that names what is wrong, and exit status 2; a file that is not there is a failure."""
    file = str(write(tmp_path / "a.raw", [1000]))
    played = ["stream", "--emulate", "evk4", "--file", file]
    for status, arguments, text in (
        (2, ["info", "--emulate", "evk5"], "no camera model 'evk5'; did you mean 'evk"),
        (2, ["stream", "--emulate", "evk4"], "an emulated evk4 sends a recording: give it with"),
        (2, ["info", "--emulate", "evk4", "--serial", "1"], "emulate and serial are given"),
        (2, ["info", "--file", file, "--serial", "1"], "file and serial are given"),
        (2, ["info", "--emulate", "evk4", "--faults", "bussy"], "did you mean 'busy'"),
        (2, [*played, "--set", "bias_fi=1"], "no setting 'bias_fi'; did you mean 'bias_fo'"),
        (2, [*played, "--set", "bias_fo=9999"], "bias_fo is 9999 codes from the factory's; it must be -35 to 55"),
        (2, [*played, "--set", "bias_fo"], "a setting is given as name=value"),
        (2, [*played, "--packet-ms", "0"], "packet_ms is 0 ms; it must be"),
        (2, ["stream", "--file", file, "--packet-ms", "0"], "packet_ms is 0 ms; it must be"),
        (1, ["stream", "--emulate", "evk4", "--file", "/none/a.raw"], "no such file"),
    ):
        assert (main(["camera", *arguments]), arguments) == (status, arguments)
        assert text in capsys.readouterr().err


@pytest.mark.parametrize("model", ["davis346", "evk4"])
def test_launch_sends_the_simulators_events_through_a_driver(tmp_path, model):
    """`evis launch emulated_camera` as a user starts it: the same events, in whole us."""
    bag = str(tmp_path / "both.mcap")
    words = ["launch", "emulated_camera", f"emulate:={model}", "width:=64", "height:=48", "audit:=0", "--compose"]
    assert main([*words, "--duration", "0.1", "--no-view", "--record", bag]) == 0
    sent, got = (evis.open(bag, topic=f"/{name}/events")[:].numpy() for name in ("cam0", "usb0"))
    assert len(sent["t"]) > 1000
    assert all(np.array_equal(sent[name], got[name]) for name in "xyp")
    assert np.array_equal(sent["t"] - sent["t"] % 1000, got["t"])


def test_launch_streams_a_recording_through_the_driver(tmp_path):
    """`evis launch camera.yaml emulate:=... file:=...` as a user starts it: everything arrives, it ends by itself."""
    random_recording(tmp_path / "a.raw", 640, 480)
    command = [
        sys.executable,
        "-m",
        "evis",
        "launch",
        "camera",
        "emulate:=silkyevcam",
        f"file:={tmp_path / 'a.raw'}",
    ]
    command += ["settings:=decoder=numpy", "--record", str(tmp_path / "a.mcap"), "--no-view", "--json"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout.strip().splitlines()[-1])
    assert (summary["events"], summary["drops"]) == (20_000, 0)
    missing = subprocess.run(
        [*command[:5], "emulate:=silkyevkam", "--no-view"], capture_output=True, text=True, timeout=600
    )
    assert (
        missing.returncode == 2
        and "did you mean 'silkyevcam'?" in missing.stderr
        and "\n" not in missing.stderr.strip()
    )
