"""Whole graphs on several devices, here shares of one CPU: the very messages of a run on one, in a bag."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evis.bag.reader import BagReader
from msgs.camera import EventPacket
from msgs.header import Message

Bag = dict[str, list[Message]]
ENVS = 4
SCENE = (
    "falling_objects", f"envs:={ENVS}", "vary:=1", "seed:=3", "width:=40", "height:=32", "upsampling:=4", "audit:=8",
    "shot_rate:=20", "leak_rate:=5", "threshold_mismatch:=0.03", "crossing:=cubic", "labels:=boxes,flow,poses,events",
    "image:=true",
)  # fmt: skip
TOPICS = "/*/keyframe,/*/depth,/*/frames,/*/labels,/*/image"


def launched(runtime: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(runtime), "EVIS_NO_VIEW": "1"}
    command = [sys.executable, "-m", "evis", "launch", *words, "--json", "--duration", "0.14"]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=600)


@pytest.fixture(scope="module")
def runtime() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="ev", dir="/tmp"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def runs(runtime: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[int, tuple[dict[str, Any], Bag]]:
    """On one, two and three devices: what was told at the end, and all messages."""
    folder, found = tmp_path_factory.mktemp("shares"), {}
    for shares in (1, 2, 3):
        found[shares] = recorded(runtime, folder / f"{shares}.mcap", ",".join(["cpu"] * shares))
    return found


def recorded(runtime: Path, path: Path, device: str) -> tuple[dict[str, Any], Bag]:
    done = launched(runtime, *SCENE, f"device:={device}", "--record", str(path), "--record-topics", TOPICS)
    assert done.returncode == 0, done.stderr
    bag: Bag = {}
    with BagReader(path) as reader:
        for topic, message in reader.messages():
            bag.setdefault(topic, []).append(message)
    bag.pop("/diagnostics", None)
    return json.loads(done.stdout), bag


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    return bool(a == b or (a != a and b != b))  # NaN, where an audit knows nothing yet


@pytest.mark.parametrize("shares", [2, 3])
def test_every_message_is_that_of_one_device(runs: dict[int, tuple[dict[str, Any], Bag]], shares: int) -> None:
    assert_same(runs[1][1], runs[shares][1])


@pytest.mark.gpu
def test_every_message_is_that_of_one_gpu(runtime: Path, tmp_path: Path) -> None:
    """Of two shares on one GPU; on two where there are as many."""
    import warp as wp

    last = len(wp.get_cuda_devices()) - 1
    devices = ("cuda:0", f"cuda:0,cuda:{last}")
    one, two = (recorded(runtime, tmp_path / f"{n}.mcap", device)[1] for n, device in enumerate(devices))
    assert_same(one, two)


def assert_same(one: Bag, several: Bag) -> None:
    assert one.keys() == several.keys() >= {f"/cam0/{n}" for n in ("info", "keyframe", "events", "labels", "image")}
    for topic, messages in one.items():
        assert len(messages) == len(several[topic]), topic
        for a, b in zip(messages, several[topic]):
            differ = [f.name for f in dataclasses.fields(a) if not same(getattr(a, f.name), getattr(b, f.name))]
            assert not differ, (topic, a.header, differ)


def test_there_is_something_to_compare(runs: dict[int, tuple[dict[str, Any], Bag]]) -> None:
    packets = [m for m in runs[1][1]["/cam0/events"] if len(m.env_offsets) == ENVS + 1]
    counts = np.sum([np.diff(packet.env_offsets) for packet in packets], axis=0)
    assert (counts > 100).all() and len(set(counts.tolist())) == ENVS, "each environment is another one"


@pytest.mark.parametrize("shares", [2, 3])
def test_events_are_counted_once(runs: dict[int, tuple[dict[str, Any], Bag]], shares: int) -> None:
    one, several = runs[1][0], runs[shares][0]
    assert {key: several[key] for key in ("events", "keyframes", "frames", "drops", "audit")} == {
        key: one[key] for key in ("events", "keyframes", "frames", "drops", "audit")
    }


SPRING = """
<mujoco><worldbody><geom type="plane" size="2 2 0.1"/><body name="cart" pos="0 0 0.5">
<joint name="j" type="slide" axis="1 0 0" stiffness="1000"/><geom type="box" size="0.1 0.1 0.1"/></body></worldbody>
</mujoco>
"""
WILD = """
args: {kick: {default: {from: 0, to: 1500}, help: speed of the cart at the start}}
mjcf: spring.xml
initial_joints: {j: {velocity: "${kick}"}}
cameras: {cam0: {position: [0, -3, 1], look_at: [0, 0, 0.5], fov: 50 deg}}
environment: 0.5
"""


@pytest.mark.slow
def test_a_share_in_which_all_diverge_goes_on_with_the_others(runtime: Path, tmp_path: Path) -> None:
    """The last of three is too fast, in every gap anew, and has a share of its own."""
    (tmp_path / "spring.xml").write_text(SPRING)
    (tmp_path / "wild.yaml").write_text(WILD)
    found = []
    for device in ("cpu", "cpu,cpu"):
        bag = tmp_path / "a.mcap"
        words = ("seed:=1", "envs:=3", "width:=32", "height:=24", f"device:={device}", "image:=true")
        done = launched(runtime, str(tmp_path / "wild.yaml"), *words, "--record", str(bag), "--record-topics", TOPICS)
        assert done.returncode == 0, done.stderr
        assert done.stderr.count("environment 2: body 'cart' diverged") >= 3
        with BagReader(bag) as reader:
            messages = [(t, m.header.seq, m) for t, m in reader.messages() if t.startswith("/cam0/")]
        found.append([message for *_, message in sorted(messages, key=lambda row: row[:2])])
    for a, b in zip(*found, strict=True):
        differ = [f.name for f in dataclasses.fields(a) if not same(getattr(a, f.name), getattr(b, f.name))]
        assert not set(differ) - {"reshaded"}, (a.header, differ)
    assert sum(len(m.t) for m in found[0] if isinstance(m, EventPacket)) > 50


def test_a_device_that_is_not_there_is_named_with_those_that_are(runtime: Path) -> None:
    done = launched(runtime, "spinning_disk", "width:=32", "height:=24", "envs:=2", "audit:=0", "device:=cpu,cuda:97")
    assert done.returncode == 1
    assert "there is no device 'cuda:97' here; there is cpu" in done.stderr
