"""A message on /<cam>/settings: who is told what, what a recording says of it, and what stays over rounds and plugs."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_rig import Runtime, write
from usb_rig import random_recording

import evis
from evis.cli import main
from evis.events import Events
from msgs.camera import CameraSettings
from msgs.header import Header
from nodes.camera.node import CameraNode

LIMIT_S = 60.0
MS = 1_000_000


def asked(**values: Any) -> CameraSettings:
    return CameraSettings(Header(0), values)


def started(runtime: Runtime, **params: Any) -> CameraNode:
    node = CameraNode("camera", {"settings": ["decoder=numpy"], **params})
    node.runtime = runtime  # type: ignore[assignment]
    node.setup()
    return node


def step(node: CameraNode, condition: Callable[[], Any]) -> None:
    """Step the node until something is true."""
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert node.step({}) and time.monotonic() < end


@pytest.fixture
def evk4(tmp_path: Path) -> Iterator[tuple[CameraNode, Runtime]]:
    """A node that has published some packets of an emulated EVK4, at real pace."""
    random_recording(tmp_path / "a.raw", 1280, 720, 20_000, 30_000_000)
    runtime = Runtime()
    node = started(runtime, emulate="evk4", file=str(tmp_path / "a.raw"))
    step(node, lambda: len(runtime.messages.get("events", ())) > 3)
    yield node, runtime
    node.close()


def test_a_change_is_on_the_info_topic(evk4):
    """What holds, and between which two times of the camera's clock it came to hold."""
    node, runtime = evk4
    (first,) = runtime.messages["info"]
    assert first.sensor["settings"]["bias_fo"] == 0 and first.sensor["settings_changed_ns"] == []
    message = asked(bias_fo=-10, trigger_in=True, roi_width="64")
    node.admit("setting", message)
    node.step({})
    assert len(runtime.messages["info"]) == 1  # nothing has happened yet
    packet, before = runtime.messages["events"][-1], node.driver.device_now_ns()
    node.receive("setting", message)
    after = node.driver.device_now_ns()
    assert len(runtime.messages["info"]) == 1  # its reader may wait for this to return
    node.step({})
    info = runtime.messages["info"][-1]
    assert info.header.stamp_ns == packet.header.stamp_ns
    begun, ended = info.sensor["settings_changed_ns"]
    # no later and no earlier than the device says, or than what has been published
    published = packet.header.stamp_ns
    assert max(before, published) <= begun <= ended <= max(after, published)
    changed = {"bias_fo": -10, "trigger_in": True, "roi_width": 64}
    assert info.sensor["settings"] == first.sensor["settings"] | changed
    assert runtime.counters["settings_changed"] == 3
    told = [line for line in runtime.warnings if " from " in line]
    assert len(told) == 1 and told[0].startswith("bias_fo=-10, roi_width=64, trigger_in=true from ")
    assert any("bias_fo changes nothing" in line for line in runtime.warnings)
    node.receive("setting", message)  # it is so already
    node.step({})
    assert len(runtime.messages["info"]) == 2 and runtime.counters["settings_changed"] == 3


def test_a_change_is_behind_what_was_published(evk4, monkeypatch):
    """Where the host's estimate of the device's time is late, as that of a stream that began late is."""
    node, runtime = evk4
    published = runtime.messages["events"][-1].header.stamp_ns
    monkeypatch.setattr(node.driver, "device_now_ns", lambda: published - 5 * MS)
    node.receive("setting", asked(bias_fo=1))
    node.step({})
    assert runtime.messages["info"][-1].sensor["settings_changed_ns"] == [published, published]


def test_the_log_is_not_flooded(evk4):
    """A node may change a setting with every packet: the log tells twenty, the info topic all of them."""
    node, runtime = evk4
    for value in range(1, 31):
        node.receive("setting", asked(bias_fo=value))
        node.step({})
    told = [line for line in runtime.warnings if line.startswith("bias_fo=")]
    assert len(told) == 20 and "the next changes are only counted" in told[-1]
    values = [m.sensor["settings"]["bias_fo"] for m in runtime.messages["info"]]
    assert values == list(range(31)) and runtime.counters["settings_changed"] == 30
    for _ in range(30):
        node.receive("setting", asked(bias_fo=99))
    refused = [line for line in runtime.warnings if line.startswith("refused: ")]
    assert len(refused) == 20 and "the next ones are only counted" in refused[-1]
    assert runtime.counters["refused_settings"] == 30


def test_changes_between_two_steps_are_told_together(evk4):
    """From before the first to behind the last; also those behind the last step."""
    node, runtime = evk4
    before = node.driver.device_now_ns()
    node.receive("setting", asked(bias_fo=1))
    between = node.driver.device_now_ns()
    node.receive("setting", asked(bias_hpf=2))
    node.finish()
    _, info = runtime.messages["info"]
    begun, ended = info.sensor["settings_changed_ns"]
    assert before <= begun <= between <= ended and info.sensor["settings"]["bias_fo"] == 1


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({}, "no setting is given"),
        ({"bias_fo": [3]}, "a setting is a number, true or false, or a text"),
        ({"bias_fo": None}, "a setting is a number"),
        ({"bias_fo": "x" * 1000}, "no setting is that long"),
        ({"x" * 1000: 1}, "no setting is that long"),
        ({"bias_fo": "ten"}, "bias_fo is 'ten', must be a whole number"),
        ({"bias_fo": float("nan")}, "bias_fo is 'nan', must be a whole number"),
        ({"event_rate_limit": float("nan")}, "event_rate_limit is nan; it must be finite"),
        ({"bias_fo": 3, "trigger_in": "perhaps"}, "trigger_in is 'perhaps', must be true or false"),
        ({"bias_fi": 3}, "no setting 'bias_fi'; did you mean 'bias_fo'"),
        ({"reconnect": True}, "reconnect is decided when the camera starts"),
    ],
)
def test_what_is_refused(evk4, values, told):
    """A program is answered; of a node's message the log tells. Nothing is written either way."""
    node, runtime = evk4
    count = len(node.driver.emulated.writes)
    with pytest.raises(ValueError, match=told) as caught:
        node.admit("setting", asked(**values))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
    node.receive("setting", asked(**values))
    assert runtime.counters["refused_settings"] == 1 and "settings_changed" not in runtime.counters
    assert [line for line in runtime.warnings if line.startswith("refused: ")]
    assert len(node.driver.emulated.writes) == count and len(runtime.messages["info"]) == 1


def test_a_program_is_told_of_what_failed_on_the_wire(evk4):
    """It passed all checks, and the camera did not answer: the description leaves the setting out."""
    node, runtime = evk4
    message = asked(roi_width=64)
    node.admit("setting", message)
    node.driver.emulated.faults.control_timeout = True
    with pytest.raises(ValueError, match="no answer in 1 s"):
        node.receive("setting", message)
    node.step({})
    assert "roi_width" not in runtime.messages["info"][-1].sensor["settings"]
    node.driver.emulated.faults.control_timeout = False
    node.receive("setting", asked(roi_width=0))
    node.step({})
    assert runtime.messages["info"][-1].sensor["settings"]["roi_width"] == 0


def test_a_recording_takes_none(tmp_path):
    runtime = Runtime()
    node = started(runtime, file=str(write(tmp_path / "a.npz", [MS])), settings=[])
    with pytest.raises(ValueError, match="a recording is played, which was made with the settings that its camera had"):
        node.admit("setting", asked(bias_fo=3))
    assert "settings" not in runtime.messages["info"][0].sensor
    node.close()


def test_a_camera_that_is_back_has_what_it_had(tmp_path):
    """While it is away it takes none; then its registers, which were the factory's, hold the change again."""
    random_recording(tmp_path / "a.npz", 1280, 720, 4000, 30_000_000)
    runtime = Runtime()
    node = started(runtime, emulate="evk4", file=str(tmp_path / "a.npz"), reconnect=True, faults="replug")
    device = node.driver.emulated
    step(node, lambda: "events" in runtime.messages)
    node.receive("setting", asked(bias_fo=-10))
    node.step({})
    assert runtime.messages["info"][-1].sensor["settings_changed_ns"]
    present = device.present
    device.present = lambda: False  # not plugged in yet
    device.faults.unplug_after = 1
    step(node, lambda: node.driver.counters().get("unplugged"))
    assert device.registers[0x1004] == 0x11A1_0000 | 0x53 - 10
    with pytest.raises(ValueError, match="is unplugged; set it again when it streams"):
        node.admit("setting", asked(bias_fo=4))
    device.present = present
    step(node, lambda: runtime.messages["info"][-1].header.episode == 1)
    sensor = runtime.messages["info"][-1].sensor
    assert sensor["settings"]["bias_fo"] == -10 and sensor["settings_changed_ns"] == []
    assert device.registers[0x1004] == 0x11A1_0000 | 0x53 - 10
    node.close()


def test_further_rounds_of_a_recording_keep_a_change(tmp_path, monkeypatch):
    """`again` opens the camera anew, by its launch arguments: what was set since holds all the same."""
    monkeypatch.setattr("nodes.camera.node.REST_S", 0.0)
    random_recording(tmp_path / "a.npz", 1280, 720, 500)
    runtime = Runtime()
    node = started(runtime, emulate="evk4", file=str(tmp_path / "a.npz"), pace="fast", again=True)
    step(node, lambda: "events" in runtime.messages)
    node.receive("setting", asked(roi_width=64))
    step(node, lambda: runtime.messages["events"][-1].header.episode == 2)
    last = [m for m in runtime.messages["events"] if m.header.episode == 1]
    assert sum(len(m.t) for m in last) and all((m.x < 64).all() for m in last)
    infos = [m.sensor for m in runtime.messages["info"] if m.header.episode == 1]
    assert [(s["settings"]["roi_width"], s["settings_changed_ns"]) for s in infos] == [(64, [])]
    node.close()


# -- graphs as users start them ----------------------------------------------------------------------------------------


@pytest.fixture
def launch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start `evis launch WORDS`, in a run directory that nobody else sees."""
    runtime = tempfile.TemporaryDirectory(prefix="ev", dir="/tmp", ignore_cleanup_errors=True)
    monkeypatch.setenv("XDG_RUNTIME_DIR", runtime.name)
    path = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
    graphs = []

    def start(*words: str) -> subprocess.Popen[str]:
        graphs.append(
            subprocess.Popen(
                [sys.executable, "-m", "evis", "launch", *words, "--no-view"], stdout=subprocess.PIPE,
                stderr=subprocess.PIPE, text=True, cwd=tmp_path, env={**os.environ, "PYTHONPATH": path},
            )
        )  # fmt: skip
        return graphs[-1]

    yield start
    for graph in graphs:
        if graph.poll() is None:
            graph.kill()
        print(*graph.communicate())
    runtime.cleanup()


def infos_of(bag: Path) -> list[Any]:
    return list(evis.open(bag).messages("/cam0/info"))


def read_until(packets: Any, condition: Callable[[Any], bool]) -> Any:
    """The first packet of which it is true."""
    while (packet := packets.read(LIMIT_S)) is not None and not condition(packet):
        pass
    assert packet is not None, "no packet came, or the graph has ended"
    return packet


def is_cut(events: Any) -> np.ndarray:
    """Which events lie outside of 300 columns from 100 on."""
    return (events.x < 100) | (events.x >= 400)


def test_from_the_command_line_and_from_python(launch, tmp_path, capsys):
    """The registers follow, the stream goes on, and the bag tells which part was made with what."""
    sent = random_recording(tmp_path / "a.raw", 1280, 720, 300_000, 30_000_000)
    words = ["emulate:=evk4", f"file:={tmp_path / 'a.raw'}", "settings:=decoder=numpy"]
    graph = launch("camera", *words, "--record", "a.mcap", "--json")
    with evis.connect(wait_s=LIMIT_S) as run:
        packets = run.topic("/cam0/events")
        read_until(packets, lambda p: p.header.stamp_ns >= 300 * MS)
        assert main(["camera", "set", "roi_x=100", "roi_width=300"]) == 0
        assert "camera: roi_x=100, roi_width=300 set after the packet of " in capsys.readouterr().out
        assert main(["camera", "set", "bias_fo=99", "roi_width=5"]) == 1
        assert "bias_fo is 99 codes from the factory's; it must be -35 to 55" in capsys.readouterr().err
        for wrong, told in ((["bias_fo"], "given as NAME=VALUE"), (["bias_fo=1", "bias_fo=2"], "given twice")):
            assert main(["camera", "set", *wrong]) == 2 and told in capsys.readouterr().err
        assert main(["camera", "set", "bias_fo=1", "--camera", "cam7"]) == 1
        assert "takes no /cam7/settings from outside: nobody in it reads that; it takes" in capsys.readouterr().err
        assert main(["topic", "pub", "/cam0/settings", '{"bias_fo": 1}']) == 1
        assert "`evis camera set NAME=VALUE` changes settings of a camera" in capsys.readouterr().err
        with pytest.raises(ValueError, match="trigger_in is 'maybe', must be true or false"):
            run.set_camera(trigger_in="maybe")
        seen = read_until(packets, lambda p: len(p.x) > 0 and not is_cut(p).any()).header.stamp_ns
        read_until(packets, lambda p: p.header.stamp_ns >= seen + 300 * MS)
        after = run.set_camera("cam0", roi_x=0, roi_width=np.int64(0), trigger_in=True)
        assert seen < after < 29_000 * MS
        seen = read_until(packets, lambda p: is_cut(p).any()).header.stamp_ns
        read_until(packets, lambda p: p.header.stamp_ns >= seen + 300 * MS)
    graph.send_signal(signal.SIGINT)
    out, err = graph.communicate(timeout=LIMIT_S)
    assert graph.returncode == 0, err
    assert "camera: roi_x=100, roi_width=300 from " in err and "camera: warning: refused: bias_fo is 99 codes" in err
    # the first of those with the same width: every 5 s there is one more, with the temperature
    by_width = groupby(infos_of(tmp_path / "a.mcap"), lambda m: m.sensor["settings"]["roi_width"])
    first, cut, whole = (next(same) for _, same in by_width)
    assert [m.sensor["settings"]["roi_width"] for m in (first, cut, whole)] == [0, 300, 0]
    assert whole.sensor["settings"]["trigger_in"] is True and '"refused_settings": 2' in out
    got = Events(*(evis.open(tmp_path / "a.mcap")[:].numpy()[name] for name in "txyp"))
    # where nothing of the other columns comes, for far longer than between any two of their events: 1 ms at the most
    others = got.t[is_cut(got)]
    k = int(np.argmax(np.diff(others)))
    last, again = others[k], others[k + 1]
    assert again - last > 200 * MS
    # of what is published nothing was made later; an emulated device has made up to 20 ms beforehand
    assert cut.header.stamp_ns - 5 * MS < last < cut.sensor["settings_changed_ns"][1] + 20 * MS
    assert whole.header.stamp_ns < again < whole.sensor["settings_changed_ns"][1] + 25 * MS
    is_there = ~is_cut(sent) | (sent.t <= last) | (sent.t >= again)
    wanted = sent[is_there & (sent.t <= got.t[-1])]
    assert all(np.array_equal(getattr(got, name), getattr(wanted, name)) for name in "txyp")


CONTROLLER = """
from evis.runtime.node import Input, Node, Output
from msgs.camera import CameraSettings
from msgs.header import Header

class Controller(Node):
    INPUTS = {"events": Input("/cam0/events"), "info": Input("/cam0/info")}
    OUTPUTS = {"settings": Output("/cam0/settings")}

    def setup(self):
        self.k, self.told = 0, []

    def receive(self, port, message):
        self.told.append(message.sensor["settings"]["roi_width"])

    def update(self, inputs):
        for _ in range(5):  # more than wait on the way: it and the camera must not wait for each other
            self.k += 1
            width = 9999 if self.k == 13 else 64 + self.k % 100
            self.publish("settings", CameraSettings(Header(inputs["events"].header.stamp_ns), {"roi_width": width}))

    def finish(self):
        self.result("asked", self.k)
        self.result("told", self.told)
"""
GRAPH = """
include: camera
nodes:
  controller: {type: "controller:Controller", keep: [settings]}
"""


def test_a_node_of_the_graph_sets_them(launch, tmp_path):
    """A controller of biases closes its loop; its messages are recorded, and one that is refused ends nothing."""
    random_recording(tmp_path / "a.raw", 1280, 720, 6000, 1_500_000)
    (tmp_path / "controller.py").write_text(CONTROLLER)
    (tmp_path / "controlled.yaml").write_text(GRAPH)
    words = ["emulate:=evk4", "file:=a.raw", "settings:=decoder=numpy", "--record", "a.mcap", "--json"]
    graph = launch("controlled.yaml", *words)
    out, err = graph.communicate(timeout=LIMIT_S)
    assert graph.returncode == 0, err
    assert "camera: roi_width=65 from " in err and "camera: warning: refused: roi_width is 9999 px" in err
    summary = json.loads(out.strip().splitlines()[-1])
    counters = summary["nodes"]["camera"]["counters"]
    late = summary["asked"] - counters["settings_changed"] - counters["refused_settings"]
    assert counters["refused_settings"] == 1 and 0 <= late <= 10 < 300 < summary["asked"]  # behind the last packets
    rec = evis.open(tmp_path / "a.mcap")
    wanted = [9999 if k == 13 else 64 + k % 100 for k in range(1, summary["asked"] + 1)]
    assert [m.values for m in rec.messages("/cam0/settings")] == [{"roi_width": width} for width in wanted]
    held = [m.sensor["settings"]["roi_width"] for m in infos_of(tmp_path / "a.mcap")]
    assert held == summary["told"] and held[0] == 0 and held[-1] in wanted[-11:] and len(held) > 50


def test_a_simulated_camera_takes_none(launch, capsys):
    """What makes its events is decided at the start, so that a seed gives the same bytes."""
    graph = launch("spinning_disk", "width:=64", "height:=48", "audit:=0", "pace:=realtime")
    with evis.connect(wait_s=LIMIT_S) as run:
        assert run.topic("/cam0/events").read(LIMIT_S) is not None
        with pytest.raises(ConnectionRefusedError, match=r"cam0 are simulated .*start it again with other arguments"):
            run.set_camera(threshold=0.3)
        with pytest.raises(
            ConnectionRefusedError, match="takes no /cam5/settings from outside: nobody in it reads that"
        ):
            run.set_camera("cam5", threshold=0.3)
    assert main(["camera", "set", "threshold=0.3"]) == 1
    assert "are simulated or replayed (event_sensor)" in capsys.readouterr().err
    graph.send_signal(signal.SIGINT)
    graph.communicate(timeout=LIMIT_S)
    assert graph.returncode == 0
